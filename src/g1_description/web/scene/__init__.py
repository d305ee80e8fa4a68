"""The scene: robots, frames, marks, trails."""
