"""Recurrent predictive-state policies: filters learned by regression, policies that act on their states (chapter 5)."""
