"""SDF documents to models and worlds."""
