"""Which file is meant, and reading and writing it whole."""
