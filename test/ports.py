"""TCP ports for tests."""

import random
import socket


def free_port():
    """Find a TCP port that nobody listens on, below those that the system gives."""
    while True:
        try:
            place = "localhost", random.SystemRandom().randrange(20_000, 32_000)
            with socket.create_server(place) as listener:
                return listener.getsockname()[1]
        except OSError:
            continue
