"""Robot: the package's interface for Python programs."""
