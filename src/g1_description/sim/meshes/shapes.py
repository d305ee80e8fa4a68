"""Finding, checking and reading meshes for PyBullet, whose readers trust any file.

PyBullet may read a binary STL itself, after its length and numbers were checked. Other
files are read with assimp, as in RViz, by ``read_meshes`` in a child process.

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
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Tuple, Union

import numpy as np

from g1_description.bounds import MAX_VALUE
from g1_description.files.model_files import find_folder
from g1_description.files.uris import local_path
from g1_description.robot.description import Shape
from g1_description.sim.meshes.read_meshes import BEGUN, LAST_WORDS
from g1_description.sim.meshes.stl import (
    HEAD,
    RECORD,
    binary_size,
    has_direction,
    triangle_count,
    triangle_normals,
)

KINDS = (".dae", ".obj", ".stl")
"""Kinds of meshes that Gazebo takes."""


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
class Mesh:
    """A mesh file."""

    path: Path
    parts: tuple[Part, ...] = ()
    """Empty if PyBullet reads the file itself."""


def find_meshes(shapes: Iterable[Shape]) -> tuple[dict[str, Mesh], tuple[str, ...]]:
    """Find and read the meshes of a model.

    Args:
        shapes: Its shapes; those that are not meshes are ignored.

    Returns:
        The meshes by their names in the file, and a message for each that cannot be
        used.
    """
    names = [shape.filename for shape in shapes if shape.kind == "mesh"]
    found: dict[str, Mesh] = {}
    left_out = []
    paths: dict[str, Path] = {}
    for name in dict.fromkeys(names):
        path = local_path(name, find_folder)
        if path is None:
            left_out.append(f"mesh {name} does not exist")
        elif path.suffix.lower() not in KINDS:
            left_out.append(f"mesh {name} must be one of {', '.join(KINDS)}")
        else:
            paths[name] = path
    meshes = open_meshes(paths.values())
    for name, path in paths.items():
        mesh = meshes[path]
        if isinstance(mesh, str):
            left_out.append(f"mesh {name} cannot be read" + (mesh and f": {mesh}"))
        else:
            found[name] = mesh
    return found, tuple(left_out)


def scaled_parts(mesh: Mesh, scale: Sequence[float]) -> list[Part]:
    """Read the triangles of a mesh, to be drawn at a scale.

    Args:
        mesh: The mesh.
        scale: Along x, y and z; negative ones mirror it.

    Returns:
        Its parts, with normals of length 1 or 0. Their triangles are anticlockwise seen
        from outside, as those of the mesh.
    """
    parts = mesh.parts
    if not parts:
        records = np.fromfile(str(mesh.path), RECORD, offset=HEAD)
        normals = np.repeat(records["normal"][:, np.newaxis], 3, axis=1)
        parts = (Part(records["corners"], normals, None),)
    factors = np.array(scale)
    turn = 1 if np.prod(factors) > 0 else -1
    found = []
    for part in parts:
        with np.errstate(all="ignore"):
            normals = part.normals / factors
            normals /= np.linalg.norm(normals, axis=2, keepdims=True)
        corners = (part.corners * factors)[:, ::turn]
        found.append(Part(corners, np.nan_to_num(normals)[:, ::turn], part.color))
    return found


def is_there(shape: Shape, meshes: Mapping[str, Mesh]) -> bool:
    """Return whether a shape is not a mesh, or one that was found."""
    return shape.kind != "mesh" or shape.filename in meshes


def open_meshes(paths: Iterable[Path]) -> dict[Path, Mesh | str]:
    """Open mesh files.

    Args:
        paths: Existing files of these ``KINDS``.

    Returns:
        By file: a mesh, or a message on why it cannot be read.
    """
    found: dict[Path, Mesh | str] = {}
    unread = []
    for path in dict.fromkeys(paths):
        if is_sound_stl(path):
            found[path] = Mesh(path)
        else:
            unread.append(path)
    for path, content in mesh_contents(unread).items():
        found[path] = content if isinstance(content, str) else Mesh(path, content)
    return found


def is_sound_stl(path: Path) -> bool:
    """Return whether a file is a binary STL that PyBullet can read safely.

    Its size must match its number of triangles, as PyBullet computes it in 32 bits and
    reads beyond the end. It must have normals, without which it is black.

    Args:
        path: An existing file.
    """
    if path.suffix.lower() != ".stl":
        return False
    try:
        size = path.stat().st_size
        with path.open("rb") as file:
            head = file.read(HEAD)
        count = triangle_count(head)
        if not count or size != binary_size(head):
            return False
        records = np.fromfile(str(path), RECORD, count, offset=HEAD)
    except OSError:
        return False
    with np.errstate(invalid="ignore"):
        if not (np.abs(records["corners"]) <= MAX_VALUE).all():
            return False
    mute = records["corners"][~has_direction(records["normal"])]
    # Triangles without area are invisible and need no normal.
    return not triangle_normals(mute).any()


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
    return {path: contents[file] for path, file in files.items()}


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
    if code >= 0:
        return f"its reader exited with code {code}"
    if code == -signal.SIGPROF:
        return f"it took more than {FILE_PROCESSOR_TIMEOUT:g} s of processor time"
    if code == -signal.SIGALRM:
        return f"it took more than {FILE_TIMEOUT:g} s"
    return f"its reader was killed by signal {-code} ({signal.strsignal(-code)})"


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
