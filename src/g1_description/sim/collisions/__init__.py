"""Collisions of a robot with itself: which pairs of links, how deep and where."""
