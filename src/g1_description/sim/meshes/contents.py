"""Contents of mesh files, read by ``read_meshes`` in child processes.

One process reads all files of a model. If it crashes on a file, that file is skipped,
and another process continues with the next.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Tuple, Union

import numpy as np

from g1_description.sim.meshes.read_meshes import BEGUN, LAST_WORDS

READ_TIMEOUT = 60.0
"""Longest time for all meshes of a model, in [s]."""

FILE_TIMEOUT = 20.0
"""Longest time for one file, in [s]; it may refer to a pipe."""

FILE_PROCESSOR_TIMEOUT = 5.0
"""Longest processor time for one file, in [s]."""

FAILURE_LIFETIME = 60.0
"""Time for which a crash of a reader is cached, in [s].

It may be caused by a busy machine or lack of memory, but one spawn reads the same files
several times.
"""

CACHE_SIZE = 400e6
"""Largest size of the cache in bytes."""


@dataclass(frozen=True)
class Part:
    """A part of a mesh, of one colour."""

    corners: np.ndarray
    """Corners of triangles, in [m], shape (n, 3, 3)."""

    normals: np.ndarray
    """At the corners, shape (n, 3, 3)."""

    color: tuple[float, ...] | None
    """Red, green, blue, opacity from 0 to 1; None if not given."""


@dataclass(frozen=True)
class _File:
    """A file as it is now."""

    path: Path
    size: int
    changed: int
    """When, in [ns]."""


Content = Union[Tuple[Part, ...], str]
"""Parts of a mesh, or why it cannot be read."""

_known: dict[_File, Content] = {}
_deaths: dict[_File, float] = {}
"""Files on which readers crashed, with the monotonic time in [s]."""


def mesh_contents(paths: Iterable[Path]) -> dict[Path, Content]:
    """Return the contents of mesh files, with a cache.

    Args:
        paths: Existing files.
    """
    files = {}
    for path in paths:
        status = path.stat()
        files[path] = _File(path, status.st_size, status.st_mtime_ns)
    for file, when in list(_deaths.items()):
        if time.monotonic() - when >= FAILURE_LIFETIME:
            del _deaths[file], _known[file]
    contents: dict[_File, Content] = {}
    for file in files.values():
        if file in _known:  # the most recently used come last
            contents[file] = _known[file] = _known.pop(file)
    contents.update(_read_all([f for f in files.values() if f not in contents]))
    _forget_oldest()
    return {path: contents[file] for path, file in files.items()}


def _forget_oldest() -> None:
    """Remove the least recently used files from a cache that is too large."""
    sizes = {
        file: sum(part.corners.nbytes + part.normals.nbytes for part in content)
        for file, content in _known.items()
        if not isinstance(content, str)
    }
    excess = sum(sizes.values()) - CACHE_SIZE
    for file, size in sizes.items():
        if excess > 0:
            del _known[file]
            excess -= size


def _read_all(files: list[_File]) -> dict[_File, Content]:
    """Read files, and cache their contents."""
    late = f"reading all meshes took more than {READ_TIMEOUT:g} s"
    contents: dict[_File, Content] = dict.fromkeys(files, late)
    end = time.monotonic() + READ_TIMEOUT
    while files and time.monotonic() < end:
        paths = [file.path for file in files]
        results, death, has_begun = _read(paths, end - time.monotonic())
        read = dict(zip(files, results))
        contents.update(read)
        _known.update(read)
        files = files[len(results) :]
        if not files or not death:
            continue
        if not has_begun:
            contents.update(dict.fromkeys(files, death))
            break
        contents[files[0]] = _known[files[0]] = death
        _deaths[files[0]] = time.monotonic()
        files = files[1:]
    return contents


def _read(paths: list[Path], timeout: float) -> tuple[list[Content], str, bool]:
    """Read files in a child process, until one crashes it.

    Returns:
        Contents or errors of the first files; why the process ended, empty after a
        timeout; whether it began to read.
    """
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        code = _run(folder, paths, timeout)
        results: list[Content] = []
        for number in range(len(paths)):
            why_not, content = (folder / f"{number}{s}" for s in (".txt", ".npz"))
            if why_not.exists():
                results.append(why_not.read_text(encoding="utf-8"))
            elif content.exists():
                results.append(_parts(content))
            else:
                break
        has_begun = (folder / BEGUN).exists()
        death = "" if code is None else _death(code)
        if (folder / LAST_WORDS).exists():
            death += f": {(folder / LAST_WORDS).read_text(encoding='utf-8')}"
        elif death and not has_begun:
            death += " before it began"
    return results, death, has_begun


def _run(folder: Path, paths: list[Path], timeout: float) -> int | None:
    """Run ``read_meshes``; return its exit code, None after a timeout.

    It runs in the folder of its results: Python would import modules from the current
    folder first.
    """
    program = [sys.executable, "-m", f"{__package__}.read_meshes"]
    limits = [str(FILE_PROCESSOR_TIMEOUT), str(FILE_TIMEOUT)]
    files = [os.path.abspath(path) for path in paths]
    try:
        return subprocess.run(
            [*program, folder, *limits, *files],
            cwd=folder,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            env={
                **os.environ,
                "PYTHONPATH": os.pathsep.join(sys.path),
                "OPENBLAS_NUM_THREADS": "1",
            },
            timeout=timeout,
            check=False,
        ).returncode
    except subprocess.TimeoutExpired:
        return None


def _death(code: int) -> str:
    """Describe the exit code of a reader."""
    if code == -signal.SIGPROF:
        return f"it took more than {FILE_PROCESSOR_TIMEOUT:g} s of processor time"
    if code == -signal.SIGALRM:
        return f"it took more than {FILE_TIMEOUT:g} s"
    if code < 0:
        return f"its reader was killed by signal {-code} ({signal.strsignal(-code)})"
    return f"its reader exited with code {code}"


def _parts(content: Path) -> tuple[Part, ...]:
    """Load the results of ``read_meshes``."""
    with np.load(content) as arrays:
        ends = np.cumsum(arrays["counts"])[:-1]
        return tuple(
            Part(corners, normals, None if np.isnan(color[0]) else tuple(color))
            for corners, normals, color in zip(
                np.split(arrays["corners"], ends),
                np.split(arrays["normals"], ends),
                arrays["colors"].tolist(),
            )
        )
