"""Files checked by several processes of this machine."""

from __future__ import annotations

import multiprocessing
import os
import pickle
import signal
import threading
from collections.abc import Iterator
from concurrent.futures import Future, ProcessPoolExecutor
from contextlib import contextmanager

from g1_description.checks.batch import FileChecker, Here, Task, check_content
from g1_description.checks.report import Outcome

START_METHOD = "spawn"
"""A process begins with nothing of ours: no PyBullet, and no lock that is held here."""


class Processes(Here):
    """Processes that check files, each one at a time."""

    def __init__(self, checker: FileChecker, count: int) -> None:
        super().__init__(checker)
        self._pickled = pickle.dumps(checker)
        self._count = count
        self._others = multiprocessing.active_children()
        self.ahead = 2 * count
        self._pool = self._started()

    def _started(self) -> ProcessPoolExecutor:
        context = multiprocessing.get_context(START_METHOD)
        return ProcessPoolExecutor(self._count, context, _prepare)

    def submit(self, task: Task) -> Future[Outcome]:
        """Begin to check a file; with the first ones processes start."""
        with _signals_held():
            return self._pool.submit(check_content, self._pickled, task.name, task.path)

    def restart(self) -> None:
        """Begin again after a process died."""
        self._pool.shutdown()
        self._pool = self._started()

    def close(self) -> None:
        """End all processes at once, whatever they are doing."""
        for process in multiprocessing.active_children():
            if process not in self._others:
                process.kill()
        self._pool.shutdown()


@contextmanager
def _signals_held() -> Iterator[None]:
    """Hold Ctrl-C back; processes that start meanwhile never get it.

    A terminal sends it to all of them, and this one ends the others.
    """
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _prepare() -> None:
    """Let this process end with the one that started it."""
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)
