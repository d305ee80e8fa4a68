"""Commands that play and record motions."""
