"""Files judged by several processes of this machine."""

from __future__ import annotations

import multiprocessing
import os
import signal
import threading
from collections import deque
from collections.abc import Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from functools import partial
from multiprocessing.process import BaseProcess

from g1_description.checks.batch import Judge, Reader, Setup, Task
from g1_description.checks.report import Outcome

ATTEMPTS = 3
"""How often a file is begun: whoever dies of it three times dies of it."""

START_METHOD = "spawn"
"""A process begins with nothing of ours: no PyBullet, and no lock that is held here."""


class Workers:
    """Processes that judge files, each one at a time.

    Each is a pool of its own, so that it is known which file one dies of.
    """

    def __init__(self, setup: Setup, read: Reader, count: int) -> None:
        """Prepare; the processes start with the first files.

        Args:
            setup: What is judged; no error may come of it.
            read: Reads a motion; it can be sent to another process.
            count: How many processes there are at most.
        """
        self._setup, self._read, self._count = setup, read, count
        self._pools: list[ProcessPoolExecutor] = []
        self._processes: list[BaseProcess] = []

    def judged(self, tasks: Sequence[Task]) -> Iterator[tuple[Task, Outcome]]:
        """Judge files.

        Args:
            tasks: The files.

        Returns:
            Outcomes as they come; those of files whose processes died are the last.
        """
        waiting = deque((task, 1) for task in tasks)
        free = [self._started() for _ in range(min(self._count, len(tasks)))]
        busy: dict[Future[Outcome], tuple[ProcessPoolExecutor, Task, int]] = {}
        while waiting or busy:
            while waiting and free:
                task, attempt = waiting.popleft()
                pool = free.pop()
                try:
                    busy[self._submit(pool, task)] = pool, task, attempt
                except BrokenProcessPool:  # it died while it had nothing to do
                    self._end(pool)
                    free.append(self._started())
                    waiting.appendleft((task, attempt))
            for future in wait(busy, return_when=FIRST_COMPLETED).done:
                pool, task, attempt = busy.pop(future)
                try:
                    outcome = future.result()
                except BrokenProcessPool:
                    self._end(pool)
                    free.append(self._started())
                    if attempt < ATTEMPTS:
                        waiting.append((task, attempt + 1))
                    else:
                        yield task, Outcome(task.name, problem=_died())
                else:
                    free.append(pool)
                    yield task, outcome

    def _started(self) -> ProcessPoolExecutor:
        """Make a process that judges."""
        pool = ProcessPoolExecutor(
            1,
            multiprocessing.get_context(START_METHOD),
            initializer=_prepare,
            initargs=(self._setup, self._read),
        )
        self._pools.append(pool)
        return pool

    def _submit(self, pool: ProcessPoolExecutor, task: Task) -> Future[Outcome]:
        """Give a file to a process; with its first one it starts."""
        others = multiprocessing.active_children()
        with _signals_held():
            future = pool.submit(_judged, task)
        started = [p for p in multiprocessing.active_children() if p not in others]
        self._processes += started
        return future

    def _end(self, pool: ProcessPoolExecutor) -> None:
        """Wait for the end of a process."""
        self._pools.remove(pool)
        pool.shutdown()

    def close(self) -> None:
        """End all processes at once, whatever they are doing."""
        for process in self._processes:
            process.kill()
        while self._pools:
            self._end(self._pools[-1])


def _died() -> str:
    """Tell why a file is given up."""
    return f"the process that checked it died, {ATTEMPTS} times"


@contextmanager
def _signals_held() -> Iterator[None]:
    """Hold Ctrl-C back; processes that start meanwhile never get it.

    A terminal sends it to all of them, and this one ends the others.
    """
    held = {signal.SIGINT}
    before = signal.pthread_sigmask(signal.SIG_BLOCK, held)
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


_judge: Judge
_read: Reader


def _prepare(setup: Setup, read: Reader) -> None:
    """Prepare this process."""
    global _judge, _read
    threading.Thread(target=_end_with_parent, daemon=True).start()
    _judge, _read = Judge(setup), read


def _judged(task: Task) -> Outcome:
    """Judge a file in this process."""
    return _judge.outcome(task.name, partial(_judge.read_file, task.path, _read))


def _end_with_parent() -> None:
    """End this process when the one that started it has ended."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)
