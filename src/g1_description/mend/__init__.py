"""Mending motions: what checks find is removed with small changes."""
