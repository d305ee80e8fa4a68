"""Finding, reading and atomically writing files."""
