"""Contents of mesh files, read in a child process, and their hulls."""
