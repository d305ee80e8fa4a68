"""What is seen in the browser: robots, their frames, marks and trails."""
