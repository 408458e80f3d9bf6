"""Artifacts: files written whole, tables with their schema and units, and where each came from."""
