"""The report on control."""
