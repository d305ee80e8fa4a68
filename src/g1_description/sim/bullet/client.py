"""PyBullet without the output of its C code."""

from __future__ import annotations

import contextlib
import ctypes
import os
from collections.abc import Iterator

from g1_description.interrupts import uninterrupted


@contextlib.contextmanager
def _muted() -> Iterator[None]:
    """Discard output meanwhile, also C's, which is buffered."""
    flush = ctypes.CDLL(None).fflush
    with contextlib.ExitStack() as stack:
        nowhere = os.open(os.devnull, os.O_WRONLY)
        stack.callback(os.close, nowhere)
        flush(None)
        for output in (1, 2):
            with contextlib.suppress(OSError):  # it is closed
                own = os.dup(output)
                stack.callback(os.close, own)
                stack.callback(os.dup2, own, output)
                os.dup2(nowhere, output)
        stack.callback(flush, None)
        yield


with _muted():  # it prints its build time
    import pybullet
    from pybullet_utils.bullet_client import BulletClient


def connect() -> BulletClient:
    """Create a PyBullet client."""
    with uninterrupted(), _muted():  # its destructor fails after an interrupt
        return BulletClient(pybullet.DIRECT)
