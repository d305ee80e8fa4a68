"""Files of motions, a module per format."""
