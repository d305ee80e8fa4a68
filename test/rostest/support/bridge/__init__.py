"""Parts of the rostests that run the bridge with the small robot `arm`."""
