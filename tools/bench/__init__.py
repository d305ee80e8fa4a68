"""What tools/benchmark measures, a module per part."""
