"""Pictures of a robot."""
