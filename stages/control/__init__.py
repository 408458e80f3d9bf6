"""Stages of the control branch."""
