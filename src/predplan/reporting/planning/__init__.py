"""The report on planning."""
