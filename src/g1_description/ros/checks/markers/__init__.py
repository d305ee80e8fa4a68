"""What checks find, as markers for RViz."""
