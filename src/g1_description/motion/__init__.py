"""Whole-body motions: in memory, sampled, edited, played, compared."""
