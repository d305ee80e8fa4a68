"""The display for long, disturbed on purpose. Called by tools/soak."""
