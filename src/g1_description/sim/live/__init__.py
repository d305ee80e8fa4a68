"""Verdicts on robots as they are now."""
