"""Figures: the paper's, and their common style."""
