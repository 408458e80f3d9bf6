"""Stages of the planning branch."""
