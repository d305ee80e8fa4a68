"""Waiting for a condition, with a deadline."""

import threading
import time

DEADLINE = 300.0
"""Longest wait for anything in [s]: many times what it takes on a busy machine, which
costs nothing where a test passes."""


def wait_for(condition, what, deadline=DEADLINE):
    """Wait until a condition gives something true; give that back.

    Args:
        condition: Called again and again.
        what: Completes "waited in vain for".
        deadline: Longest wait in [s] of wall time.
    """
    pause = threading.Event()
    end = time.monotonic() + deadline
    while time.monotonic() < end:
        result = condition()
        if result:
            return result
        pause.wait(0.01)
    raise AssertionError(f"waited {deadline} s in vain for {what}")
