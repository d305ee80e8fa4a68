"""The client with which Python programs step the stand-in."""
