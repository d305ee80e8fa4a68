"""Files of motions: each format is read in one module."""
