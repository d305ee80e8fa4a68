"""Verdicts over configurations and motions: limits, smoothness, ground, balance."""
