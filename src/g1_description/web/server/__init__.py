"""Admission to the page, and messages of browsers."""
