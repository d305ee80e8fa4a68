"""What a robot is, whatever file it came from."""
