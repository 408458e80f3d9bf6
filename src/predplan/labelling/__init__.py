"""Sequence labelling with the method of moments and anchor words (chapter 3)."""
