"""Pairs of links that may touch by design."""
