"""Signals that wait until something is done that they must not interrupt."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager

_NAMES = ("SIGINT", "SIGTERM", "SIGHUP")

ENDING_SIGNALS = tuple(getattr(signal, n) for n in _NAMES if hasattr(signal, n))
"""Signals that end programs: Ctrl-C, ``kill``, and a terminal that is closed."""


@contextmanager
def without_interrupts() -> Iterator[None]:
    """Start processes that never receive Ctrl-C, where a system can do so."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


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
