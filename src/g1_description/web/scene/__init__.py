"""What is seen: robots, frames, marks, trails."""
