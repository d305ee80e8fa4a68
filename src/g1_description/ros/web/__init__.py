"""The node ``web``: the robots of a bridge in a browser."""
