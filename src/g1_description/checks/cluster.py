"""Files judged by the workers of a Dask cluster.

Their contents are sent, so that workers need not see the disks of this machine, nor
have ROS: bags are read here. Scheduler and workers have this package, installed with
pip.
"""

from __future__ import annotations

import hashlib
import logging
import threading
import time
import uuid
import warnings
from collections.abc import Iterator, Sequence
from functools import lru_cache, partial
from pathlib import Path
from typing import Any, Union

from g1_description.checks.batch import Judge, Reader, Setup, Task
from g1_description.checks.cluster_worker import Package, judged_content, packed
from g1_description.checks.report import Outcome
from g1_description.errors import ClusterError, MotionError, cause
from g1_description.files.model_files import share_folder
from g1_description.motion.files.read import BAG, MAX_FILE_SIZE, beginning
from g1_description.motion.motion import Motion

ROOMS = ("core", "sim")
"""What judges motions."""

CONFIG = "collisions*.yaml"
"""What it reads, of the package's folder config."""


@lru_cache(maxsize=None)
def fingerprint() -> str:
    """Compute a digest of the code that judges motions, and of what it reads."""
    found = hashlib.sha256()
    folder = Path(__file__).resolve().parents[1]
    files = sorted((share_folder() / "config").glob(CONFIG))
    for room in ROOMS:
        files += sorted((folder / room).rglob("*.py"))
    for file in files:
        found.update(file.name.encode("utf-8") + file.read_bytes())
    return found.hexdigest()


TIMEOUT = 10.0
"""Longest wait for a scheduler, and for its first worker, in [s]."""

AHEAD = 3
"""Files that are sent for each thread of a worker: while one is judged, the next ones
come."""

POLL_PERIOD = 0.02
"""Wait before it is looked again whether a file is done, in [s]: meanwhile workers have
others."""

LIBRARY = "distributed"

Content = Union[bytes, Motion]
"""What is sent of a file: all that is in it, or the motion of a bag."""


class Cluster:
    """Workers that judge files."""

    def __init__(self, setup: Setup, judge: Judge, read: Reader, address: str) -> None:
        """Connect.

        Args:
            setup: What is judged; no error may come of it.
            judge: The same, here.
            read: Reads what only this machine can.
            address: HOST:PORT of the scheduler, or a URI of Dask's.

        Raises:
            ClusterError: If there is no such cluster, or it lacks what is needed.
        """
        self._setup, self._judge, self._read = setup, judge, read
        self._address = address if "://" in address else f"tcp://{address}"
        self._dask = _library()
        self._client = self._connected()
        try:
            self._n_threads = self._checked()
            package = packed(setup)
            key = f"g1-setup-{uuid.uuid4().hex}"
            # A task, not scattered data: whoever lost it makes it again.
            self._package = self._client.submit(_same, package, key=key)
        except BaseException:
            self.close()
            raise

    def _connected(self) -> Any:
        """Connect to the scheduler."""
        logging.getLogger(LIBRARY).setLevel(logging.CRITICAL)
        try:
            return self._dask.Client(
                self._address, timeout=TIMEOUT, set_as_default=False
            )
        except (OSError, ValueError, ImportError) as error:
            raise ClusterError(
                f"There is no Dask scheduler at {self._address}: {cause(error)}."
            ) from error

    def _checked(self) -> int:
        """Check the workers; return how many threads they have."""
        try:
            self._client.wait_for_workers(1, timeout=TIMEOUT)
        except self._dask.TimeoutError as error:
            raise ClusterError(f"{self._address} has no workers.") from error
        try:
            found = {
                f"scheduler {self._address}": self._client.run_on_scheduler(
                    fingerprint
                ),
                **{f"worker {k}": v for k, v in self._client.run(fingerprint).items()},
            }
        except Exception as error:  # whatever comes of a module that is missing there
            raise ClusterError(
                f"The scheduler or a worker of {self._address} cannot import "
                f"g1_description: {cause(error)}."
            ) from error
        others = [place for place, other in found.items() if other != fingerprint()]
        if others:
            raise ClusterError(
                f"The {others[0]} has another version of g1_description."
            )
        return sum(self._client.nthreads().values())

    def judged(self, tasks: Sequence[Task]) -> Iterator[tuple[Task, Outcome]]:
        """Judge files.

        Args:
            tasks: The files.

        Returns:
            Outcomes as they come.

        Raises:
            ClusterError: If the cluster goes away.
        """
        waiting = iter(tasks)
        running = self._dask.as_completed(loop=self._client.loop)
        task_of: dict[Any, Task] = {}

        def send() -> Iterator[tuple[Task, Outcome]]:
            """Send the next file; those that need no worker are done at once."""
            for task in waiting:
                content = self._content(task)
                if isinstance(content, Outcome):
                    yield task, content
                    continue
                future = self._submitted(task, content)
                task_of[future] = task
                running.add(future)
                return

        for _ in range(AHEAD * max(self._n_threads, 1)):
            yield from send()
        while task_of:
            self._wait(running)
            future = next(running)
            task = task_of.pop(future)
            yield task, self._outcome(future, task)
            future.release()
            yield from send()

    def _wait(self, running: Any) -> None:
        """Wait until a file is done.

        Raises:
            ClusterError: If nobody is left who could do it.
        """
        pause, begin = threading.Event(), time.monotonic()
        while not running.has_ready():
            pause.wait(POLL_PERIOD)
            if time.monotonic() - begin > TIMEOUT:
                begin = time.monotonic()
                if not self._client.nthreads():
                    raise ClusterError(f"{self._address} has no workers any more.")

    def _submitted(self, task: Task, content: Content) -> Any:
        """Send a file."""
        key = f"g1-check-{task.number}-{uuid.uuid4().hex}"
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", message=".*[Ll]arge.*")
            return self._client.submit(
                judged_content, self._package, task.name, content, key=key
            )

    def _content(self, task: Task) -> Content | Outcome:
        """Read a file; the outcome where that says all."""
        try:
            size = task.path.stat().st_size
            is_bag = beginning(task.path, len(BAG)) == BAG
            if not is_bag and size <= MAX_FILE_SIZE and self._setup.topic is None:
                return task.path.read_bytes()
        except (OSError, MotionError):
            pass  # what is wrong is told by whoever reads it next
        # Bags need ROS, which workers may not have.
        read = partial(self._judge.read_file, task.path, self._read)
        return self._judge.read(task.name, read)

    def _outcome(self, future: Any, task: Task) -> Outcome:
        """Take the outcome of a file from a worker."""
        try:
            found = future.result()
            assert isinstance(found, Outcome)
            return found
        except self._dask.scheduler.KilledWorker:
            return Outcome(task.name, problem="the workers that checked it died")
        except (self._dask.CancelledError, self._dask.comm.CommClosedError) as error:
            # It names the file's key, which says nothing to anybody.
            raise ClusterError(f"The cluster {self._address} has gone.") from error
        except Exception as error:  # such as a full disk
            return Outcome(task.name, problem=f"its worker failed: {cause(error)}")

    def close(self) -> None:
        """Drop what is not done, and disconnect."""
        self._client.close(timeout=TIMEOUT)


def _same(package: Package) -> Package:
    """Give what was sent."""
    return package


def _library() -> Any:
    """Import Dask.

    Raises:
        ClusterError: If it is not there.
    """
    try:
        import distributed
        import distributed.comm
        import distributed.scheduler
    except ImportError as error:
        raise ClusterError(
            f"--dask needs the library {LIBRARY}, which is not installed: "
            "pip install distributed==2023.5.0."
        ) from error
    return distributed
