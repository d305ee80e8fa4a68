"""What a worker of a cluster does."""

from __future__ import annotations

import threading
from collections import OrderedDict
from pathlib import Path
from tempfile import TemporaryDirectory

from g1_description.core.motion.formats.read import read_motion
from g1_description.core.motion.motion import Motion
from g1_description.core.reports.outcome import Outcome

from .judge import Judge
from .package import Package, unpacked

MAX_JUDGES = 2
"""So many robots are kept ready: one that works, and one whose work ends."""

_LOCK = threading.Lock()
"""Threads of a worker take turns: what judges is made for one thread."""

_judges: OrderedDict[str, tuple[Judge, TemporaryDirectory[str]]] = OrderedDict()


def judged_content(package: Package, name: str, content: bytes | Motion) -> Outcome:
    """Judge a motion.

    Args:
        package: What is judged.
        name: Of the motion's file.
        content: All of that file, or its motion.
    """
    with _LOCK:
        judge = _judge(package)
        if isinstance(content, Motion):
            motion = content
            return judge.outcome(name, lambda: motion)
        with _folder() as folder:
            path = Path(folder, Path(name).name)
            path.write_bytes(content)
            rate = package.setup.rate
            return judge.outcome(
                name, lambda: read_motion(path, judge.description, rate)
            )


def _judge(package: Package) -> Judge:
    """Return what judges, made anew only for another package."""
    if package.key not in _judges:
        folder = _folder()
        judge = Judge(unpacked(package, Path(folder.name)))
        _judges[package.key] = judge, folder
        while len(_judges) > MAX_JUDGES:
            _, (_, old) = _judges.popitem(last=False)
            old.cleanup()
    return _judges[package.key][0]


def _folder() -> TemporaryDirectory[str]:
    """Make a folder, which Dask removes where this worker cannot any more."""
    from distributed import get_worker

    return TemporaryDirectory(dir=get_worker().local_directory)
