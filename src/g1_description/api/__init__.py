"""The interface for Python programs: a robot and what can be computed of it."""
