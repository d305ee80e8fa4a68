"""Whole-body motions: one form in memory, its interpolation, its file formats."""
