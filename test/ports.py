"""TCP ports for tests."""

import socket


def free_port():
    """Find a TCP port that nobody listens on."""
    with socket.create_server(("localhost", 0)) as listener:
        return listener.getsockname()[1]
