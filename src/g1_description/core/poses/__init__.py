"""Named poses and their file."""
