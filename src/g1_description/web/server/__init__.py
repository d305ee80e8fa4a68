"""The browser view's server, and who may use it."""
