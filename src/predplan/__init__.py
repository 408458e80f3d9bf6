"""Prediction and planning with kernels and moments (Marinho, 2018)."""

__version__ = "0.1.0"
