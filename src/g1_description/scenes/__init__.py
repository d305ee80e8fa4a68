"""Objects around a robot."""
