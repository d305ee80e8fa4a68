"""The stand-in's services, by subject."""
