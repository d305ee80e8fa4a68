"""Files checked by the workers of a Dask cluster.

The contents of the files are sent, so workers need not reach this machine's disks;
bags are read here. Scheduler and workers need this package, installed with pip.
"""

from __future__ import annotations

import hashlib
import logging
import pickle
import uuid
import warnings
from collections.abc import Mapping, Sequence
from concurrent.futures import CancelledError, Future
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from g1_description.checks.batch import (
    Content,
    FileChecker,
    Here,
    Task,
    check_content,
)
from g1_description.checks.report import FileResult
from g1_description.errors import ClusterError, MotionError, cause
from g1_description.files.model_files import find_folder
from g1_description.files.uris import local_path
from g1_description.libraries import missing
from g1_description.motion.files.formats import has_neighbours, is_recorded, read_motion
from g1_description.motion.files.source import MotionSource
from g1_description.robot.description import Shape

PACKAGES = ("files", "robot", "motion", "sim", "scenes", "collisions", "checks")
"""Packages whose code checks motions."""


@lru_cache(maxsize=None)
def fingerprint() -> str:
    """Hash the code that checks motions."""
    found = hashlib.sha256()
    folder = Path(__file__).resolve().parents[1]
    files: list[Path] = []
    for package in PACKAGES:
        files += sorted((folder / package).rglob("*.py"))
    for file in files:
        found.update(file.name.encode("utf-8") + file.read_bytes())
    return found.hexdigest()


TIMEOUT = 10.0
"""Longest wait for a scheduler, and for its first worker, in [s]."""

AHEAD = 3
"""Files in flight per thread of a worker, so that it never waits for the next one."""

LIBRARY = "distributed"


class Cluster(Here):
    """Workers that check files."""

    def __init__(self, checker: FileChecker, address: str) -> None:
        """Connect.

        Args:
            checker: Checks the files, and reads those that only this machine can.
            address: HOST:PORT of the scheduler, or a URI of Dask's.

        Raises:
            ClusterError: If there is no such cluster, or its workers cannot check.
        """
        super().__init__(checker)
        self._files = checker
        self._address = address if "://" in address else f"tcp://{address}"
        self._dask = _library()
        logging.getLogger(LIBRARY).setLevel(logging.CRITICAL)
        try:
            self._client = self._dask.Client(
                self._address, timeout=TIMEOUT, set_as_default=False
            )
        except (OSError, ValueError, ImportError) as error:
            raise ClusterError(
                f"There is no Dask scheduler at {self._address}: {cause(error)}."
            ) from error
        try:
            self.ahead = AHEAD * max(self._checked(), 1)
            self._executor = self._client.get_executor(pure=False)
            key = f"g1-checker-{uuid.uuid4().hex}"
            # A task, not scattered data: Dask recomputes it where a worker loses it.
            sent = packed(checker)
            self._pickled = self._client.submit(bytes, sent, key=key)
        except BaseException:
            self.close()
            raise

    def _checked(self) -> int:
        """Check the workers; return how many threads they have."""
        try:
            self._client.wait_for_workers(1, timeout=TIMEOUT)
        except self._dask.TimeoutError as error:
            raise ClusterError(
                f"{self._address} has no workers; start one with dask "
                f"worker {self._address}."
            ) from error
        try:
            found = {
                f"scheduler {self._address}": self._client.run_on_scheduler(
                    fingerprint
                ),
                **{f"worker {k}": v for k, v in self._client.run(fingerprint).items()},
            }
        except Exception as error:  # any error of an import on the worker
            raise ClusterError(
                f"The scheduler or a worker of {self._address} cannot import "
                f"g1_description: {cause(error)}."
            ) from error
        others = [place for place, other in found.items() if other != fingerprint()]
        if others:
            raise ClusterError(
                f"The {others[0]} has another version of g1_description; install the "
                "same version on all machines."
            )
        return sum(self._client.nthreads().values())

    def submit(self, task: Task) -> Future[FileResult]:
        """Send a file; one that cannot be read here is done at once."""
        content = self._content(task)
        if isinstance(content, FileResult):
            done: Future[FileResult] = Future()
            done.set_result(content)
            return done
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", message=".*[Ll]arge.*")
            future: Future[FileResult] = self._executor.submit(
                check_content, self._pickled, task.name, content
            )
            return future

    def _content(self, task: Task) -> Content | FileResult:
        """Read a file; a FileResult if it cannot be read."""
        try:
            source = MotionSource(task.path)
            is_whole = source.name is None and not is_recorded(source)
            if (
                is_whole
                and not has_neighbours(source)
                and self._files.options.topic is None
            ):
                return source.data
        except (OSError, MotionError):
            pass  # the reader reports the error
        # Most of a bag may be other topics, which need not be sent.
        return self._files.read(task.name, task.path)

    def result(self, task: Task, future: Future[FileResult]) -> FileResult:
        """Return the outcome of a file that is done."""
        try:
            return future.result()
        except self._dask.scheduler.KilledWorker:
            return FileResult(task.name, problem="the workers that checked it died")
        except (
            CancelledError,
            self._dask.CancelledError,
            self._dask.comm.CommClosedError,
        ) as error:
            # Dask's own message only names the key of the task.
            raise ClusterError(
                f"Lost the connection to the cluster {self._address}."
            ) from error
        except Exception as error:  # such as a full disk
            return FileResult(task.name, problem=f"its worker failed: {cause(error)}")

    def check_alive(self) -> None:
        """Raise a ClusterError if no worker is left."""
        if not self._client.nthreads():
            raise ClusterError(f"{self._address} has no workers left.")

    def close(self) -> None:
        """Cancel pending tasks and disconnect."""
        self._client.close(timeout=TIMEOUT)


def packed(checker: FileChecker) -> bytes:
    """Pickle a checker, with the meshes that the simulation reads.

    Raises:
        OSError: If a mesh cannot be read.
    """
    # Workers lack the meshes that pictures need.
    sent = replace(checker, reader=read_motion)
    meshes = {}
    if checker.checker.physics is not None:
        for link in checker.checker.description.links:
            for shape in (*link.collisions, *link.visuals):
                path = local_path(shape.filename, find_folder)
                if shape.kind == "mesh" and path is not None:
                    meshes[shape.filename] = Path(path).read_bytes()
    return pickle.dumps(_WithMeshes(sent, meshes))


class _WithMeshes:
    """A checker that writes its meshes to files where it is unpickled."""

    def __init__(self, checker: FileChecker, meshes: Mapping[str, bytes]) -> None:
        self._content = checker, meshes

    def __reduce__(self) -> Any:
        return _received, self._content


_folders = []
"""Folders of received meshes; deleted when the process ends."""


def _received(checker: FileChecker, meshes: Mapping[str, bytes]) -> FileChecker:
    """Write the received meshes and return the checker of a robot that uses them."""
    if not meshes:
        return checker
    folder = TemporaryDirectory(prefix="check_")
    _folders.append(folder)
    uris = {}
    for number, (name, content) in enumerate(meshes.items()):
        file = Path(folder.name, f"{number}{Path(name).suffix}")
        file.write_bytes(content)
        uris[name] = f"file://{file}"

    def renamed(shapes: Sequence[Shape]) -> tuple[Shape, ...]:
        names = ((shape, uris.get(shape.filename, shape.filename)) for shape in shapes)
        return tuple(replace(shape, filename=name) for shape, name in names)

    robot = checker.checker.description
    parts = ((x, renamed(x.collisions), renamed(x.visuals)) for x in robot.links)
    links = tuple(replace(x, collisions=c, visuals=v) for x, c, v in parts)
    checker.checker.description = replace(robot, links=links)
    return checker


def _library() -> Any:
    """Import Dask.

    Raises:
        ClusterError: If it is not there.
    """
    try:
        import distributed
        import distributed.comm
        import distributed.scheduler
    except ModuleNotFoundError as error:
        raise ClusterError(missing("--dask", error)) from error
    return distributed
