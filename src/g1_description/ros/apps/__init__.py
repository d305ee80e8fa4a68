"""Commands for people: pose, snapshot."""
