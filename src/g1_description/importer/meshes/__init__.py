"""The importer's work on mesh files."""
