"""PyBullet without the output of its C code."""

from __future__ import annotations

import atexit
import contextlib
import ctypes
import os
import threading
from collections.abc import Iterator

from g1_description.interrupts import uninterrupted

_swapping = threading.Lock()


@contextlib.contextmanager
def _without_stderr() -> Iterator[None]:
    """Discard output to stderr meanwhile."""
    with contextlib.ExitStack() as stack:
        nowhere = os.open(os.devnull, os.O_WRONLY)
        stack.callback(os.close, nowhere)
        with contextlib.suppress(OSError):  # it is closed
            own = os.dup(2)
            stack.callback(os.close, own)
            stack.callback(os.dup2, own, 2)
            os.dup2(nowhere, 2)
        yield


@contextlib.contextmanager
def _without_stdout_of_c() -> Iterator[None]:
    """Discard output of C's printf meanwhile.

    The file descriptor stays as it is, because other threads print to it.
    """
    libc = ctypes.CDLL(None)
    libc.fopen.restype = ctypes.c_void_p
    stdout = ctypes.c_void_p.in_dll(libc, "stdout")
    with _swapping:
        libc.fflush(None)  # earlier output of C comes first
        own, nowhere = stdout.value, libc.fopen(os.devnull.encode(), b"w")
        stdout.value = nowhere
        try:
            yield
        finally:
            stdout.value = own
            libc.fclose(ctypes.c_void_p(nowhere))


with _without_stderr():  # it prints its build time
    import pybullet
    from pybullet_utils.bullet_client import BulletClient

# Its destructor fails once the interpreter has cleared PyBullet's module.
atexit.register(delattr, BulletClient, "__del__")


def connect() -> BulletClient:
    """Create a PyBullet client."""
    # Its destructor fails after an interrupt.
    with uninterrupted(), _without_stdout_of_c():
        return BulletClient(pybullet.DIRECT)
