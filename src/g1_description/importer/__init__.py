"""import_model: the vendor's models made ready for this package."""
