"""Many files, checked by this process, by several, or by a cluster."""

from __future__ import annotations

import multiprocessing
import os
import pickle
import threading
import traceback
from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Generator, Iterator, Sequence
from concurrent.futures import (
    FIRST_COMPLETED,
    BrokenExecutor,
    Future,
    ProcessPoolExecutor,
    wait,
)
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any, Callable, Union

from g1_description.checks.report import NO_MOTION, NOT_READ, FileResult
from g1_description.errors import G1DescriptionError, MotionError, NoMotionError, cause
from g1_description.interrupts import without_interrupts
from g1_description.libraries import missing
from g1_description.motion.files.formats import read_motion
from g1_description.motion.files.source import USUAL, ReadOptions
from g1_description.motion.motion import Motion
from g1_description.robot.description import Description

if TYPE_CHECKING:
    from g1_description.checks.checker import Checker
    from g1_description.checks.verdict import Verdict

Reader = Callable[[Path, Description, ReadOptions], Motion]
"""Reads a motion as ``read_motion`` does."""

Content = Union[Path, bytes, Motion]
"""A file, its bytes, or a motion that was read."""


@dataclass(frozen=True)
class Task:
    """A file that is to be checked."""

    number: int
    """Place among all files."""

    name: str
    """Name in reports."""

    path: Path


class FileWorker(ABC):
    """A job for each of many files; it can be pickled."""

    @abstractmethod
    def outcome(self, name: str, content: Content) -> FileResult:
        """Do it; errors become the result."""


@dataclass(frozen=True, eq=False)
class FileChecker(FileWorker):
    """Checks files."""

    checker: Checker
    only: Sequence[str] = ()
    """Names of the checks to make; none: all."""

    plot: bool = False
    """Whether a picture of each motion is drawn."""

    options: ReadOptions = USUAL
    """How files are read."""

    reader: Reader = read_motion
    """Reads files."""

    scene: Callable[[Motion, Verdict], str] | None = None
    """Writes motions for the page of a report; None: there is none."""

    def outcome(self, name: str, content: Content) -> FileResult:
        """Check a file; errors become its result."""
        try:
            motion = self.read(name, content)
            if isinstance(motion, FileResult):
                return motion
            verdict = self.checker.check(motion, self.only)
            if verdict.nothing_made:
                return FileResult(name, problem=verdict.nothing_made)
            plot = b""
            if self.plot:
                # Only now: matplotlib takes most of a second.
                from g1_description.checks.plot import motion_plot

                joints = self.checker.description.movable_joints
                plot = motion_plot(name, verdict, joints)
            scene = self.scene(motion, verdict) if self.scene is not None else ""
        except G1DescriptionError as error:
            return FileResult(name, problem=str(error))
        except Exception as error:
            return FileResult(name, problem=mishap(error))
        verdict = replace(verdict, measured=None)
        return FileResult(name, verdict, plot=plot, scene=scene)

    def read(self, name: str, content: Content) -> Motion | FileResult:
        """Read a motion; the outcome where there is none."""
        robot = self.checker.description
        try:
            if isinstance(content, Motion):
                return content
            if isinstance(content, bytes):
                with TemporaryDirectory(prefix="check_") as folder:
                    path = Path(folder, Path(name).name)
                    path.write_bytes(content)
                    return read_motion(path, robot, self.options)
            return self.reader(content, robot, self.options)
        except MotionError as error:
            begin = f"{Path(name).name}: "
            problem = str(error)
            problem = problem[len(begin) :] if problem.startswith(begin) else problem
            is_other = isinstance(error, NoMotionError)
            result = NO_MOTION if is_other else NOT_READ
            return FileResult(name, problem=problem, without_verdict=result)
        except Exception as error:  # any error of a library on a damaged file
            return FileResult(name, problem=mishap(error))


def mishap(error: Exception) -> str:
    """Describe an unexpected error, with its place."""
    if isinstance(error, ModuleNotFoundError):
        return missing("this", error)
    frame = traceback.extract_tb(error.__traceback__)[-1]
    place = f"{Path(frame.filename).name}:{frame.lineno}"
    return f"internal error {type(error).__name__}: {cause(error)} ({place})"


def check_content(pickled: bytes, name: str, content: Content) -> FileResult:
    """Check a file with a pickled FileWorker, in a worker process."""
    with _LOCK:
        return _unpickled(pickled).outcome(name, content)


_LOCK = threading.Lock()
"""Threads of a worker take turns: PyBullet is made for one thread."""


@lru_cache(maxsize=2)
def _unpickled(pickled: bytes) -> Any:
    return pickle.loads(pickled)


class Here:
    """Checks files in this process; other pools have the same methods."""

    ahead = 1
    """Number of files that are submitted before the first of them is done."""

    def __init__(self, checker: FileWorker) -> None:
        self.checker = checker

    def submit(self, task: Task) -> Future[FileResult]:
        """Begin to check a file.

        Raises:
            BrokenExecutor: If the pool must be restarted.
        """
        future: Future[FileResult] = Future()
        future.set_result(self.checker.outcome(task.name, task.path))
        return future

    def result(self, task: Task, future: Future[FileResult]) -> FileResult:
        """Return the outcome of a file that is done.

        Raises:
            BrokenExecutor: If a process died; all submitted files are lost.
            ClusterError: If the cluster is gone.
        """
        return future.result()

    def restart(self) -> None:
        """Begin again after a process died."""

    def check_alive(self) -> None:
        """Raise a ClusterError if no worker is left."""

    def close(self) -> None:
        """End all work at once."""


class Processes(Here):
    """Processes that check files, each one at a time."""

    def __init__(self, checker: FileWorker, count: int) -> None:
        super().__init__(checker)
        self._pickled = pickle.dumps(checker)
        self._count = count
        self._others = multiprocessing.active_children()
        self.ahead = 2 * count
        self._pool = self._started()

    def _started(self) -> ProcessPoolExecutor:
        # Spawned processes inherit neither PyBullet nor a locked lock.
        context = multiprocessing.get_context("spawn")
        return ProcessPoolExecutor(self._count, context, _prepare, (self._pickled,))

    def submit(self, task: Task) -> Future[FileResult]:
        """Begin to check a file; the first calls start the processes."""
        # A terminal sends Ctrl-C to all processes: this one ends the others.
        with without_interrupts():
            return self._pool.submit(_check_file, task.name, task.path)

    def restart(self) -> None:
        """Begin again after a process died."""
        self._pool.shutdown()
        self._pool = self._started()

    def close(self) -> None:
        """Kill all processes."""
        for process in multiprocessing.active_children():
            if process not in self._others:
                process.kill()
        self._pool.shutdown()


def pool_of(worker: FileWorker, jobs: int, n_files: int) -> Here:
    """Choose where files are worked on: here, or in at most ``jobs`` processes."""
    count = min(jobs, n_files)
    return Processes(worker, count) if count > 1 else Here(worker)


_checkers: list[bytes] = []
"""The checker of this process, pickled. It does not come with each file: more than a
pipe holds would be sent in vain to processes that are killed, and waited for."""


def _prepare(pickled: bytes) -> None:
    """Take a checker, and let this process end with its parent."""
    _checkers.append(pickled)
    threading.Thread(target=_end_with_parent, daemon=True).start()


def _check_file(name: str, path: Path) -> FileResult:
    return check_content(_checkers[-1], name, path)


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


MOST_DEATHS = 2
"""Number of processes that may die while they check one file."""

DIED = "the worker process died twice"
"""Why a file is given up."""

PATIENCE = 10.0
"""Time without a result after which the workers are checked, in [s]."""


def check_files(pool: Here, tasks: Sequence[Task]) -> Iterator[tuple[Task, FileResult]]:
    """Check files.

    When a process dies, any of the submitted files may be the cause, so they are
    checked again one at a time. A file that kills two processes is given up.

    Returns:
        Each task and its result, as soon as it is done.

    Raises:
        ClusterError: If the cluster goes away.
    """
    waiting = deque(tasks)
    while waiting:
        for task in (yield from _until_a_death(pool, waiting)):
            deaths, alone = 0, deque([task])
            while alone:
                lost = yield from _until_a_death(pool, alone)
                deaths += len(lost)
                if deaths < MOST_DEATHS:
                    alone.extend(lost)
                else:
                    yield task, FileResult(task.name, problem=DIED)


def _until_a_death(
    pool: Here, waiting: deque[Task]
) -> Generator[tuple[Task, FileResult], None, list[Task]]:
    """Check files until all are done or a process dies; return the lost ones."""
    running: dict[Future[FileResult], Task] = {}
    lost: list[Task] = []
    has_died = False
    while running or (waiting and not has_died):
        try:
            while waiting and not has_died and len(running) < pool.ahead:
                running[pool.submit(waiting[0])] = waiting[0]
                waiting.popleft()
        except BrokenExecutor:
            has_died = True
        done = wait(running, PATIENCE, FIRST_COMPLETED).done
        if running and not done:
            pool.check_alive()
        for future in done:
            task = running.pop(future)
            try:
                yield task, pool.result(task, future)
            except BrokenExecutor:
                has_died = True
                lost.append(task)
    if has_died:
        pool.restart()
    return sorted(lost, key=lambda task: task.number)
