"""Signals that wait until something is done that they must not interrupt."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager

ENDING_SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
"""Signals that end programs: Ctrl-C, ``kill``, and a terminal that is closed."""


@contextmanager
def uninterrupted() -> Iterator[None]:
    """Hold back signals that end the program by an exception, until the block ends.

    For imports and calls of libraries that catch every exception, and so lose the
    interrupt, or that cannot be left at any place.
    """
    came: list[int] = []
    handlers = {}
    if threading.current_thread() is threading.main_thread():  # others see no signal
        handlers = {number: signal.getsignal(number) for number in ENDING_SIGNALS}
        handlers = {n: answer for n, answer in handlers.items() if callable(answer)}
    for number in handlers:
        signal.signal(number, lambda number, _: came.append(number))
    try:
        yield
    finally:
        for number, answer in handlers.items():
            signal.signal(number, answer)
        for first in came[:1]:
            signal.raise_signal(first)
