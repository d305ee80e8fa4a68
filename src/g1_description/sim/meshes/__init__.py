"""Mesh files: what is in them, read by libraries that may crash."""
