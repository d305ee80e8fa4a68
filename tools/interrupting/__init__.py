"""Ctrl-C at any moment. Called by tools/interrupts."""
