"""How many threads the libraries of linear algebra take."""

from __future__ import annotations

import os

THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
"""Where these libraries read it, once, when they are loaded."""


def one_thread() -> None:
    """Let them take one in this process and in those that it starts.

    With another number, the last bits of their results differ.
    """
    os.environ.update(dict.fromkeys(THREADS, "1"))
