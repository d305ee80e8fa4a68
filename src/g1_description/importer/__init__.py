"""The command import_model."""
