"""Pictures of the browser view for the pages."""
