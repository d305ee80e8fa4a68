"""MuJoCo behind the interface of physics engines."""
