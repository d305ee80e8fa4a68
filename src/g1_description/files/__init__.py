"""Files from outside: found, loaded and replaced whole."""
