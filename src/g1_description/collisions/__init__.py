"""Collisions of a robot with itself, for many configurations at once."""
