"""Pictures and films of robots that run, and of files."""
