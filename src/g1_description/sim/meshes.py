"""Meshes as PyBullet can be given them: its own readers trust the numbers in a file.

A binary STL it may read itself, once its length was checked. All else is read by the
library that RViz reads with, in a process of its own for all files of a model.
"""

from __future__ import annotations

import os
import struct
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..core.description import Shape
from ..core.resources import local_path

KINDS = (".dae", ".obj", ".stl")
"""Kinds of meshes that Gazebo takes."""

PATIENCE = 60.0
"""Longest time that reading all meshes of a model may take, in [s]."""

MOST_KEPT = 1000
"""Files whose content is kept, in case they are asked for again."""

_STL_HEAD, _STL_TRIANGLE = 84, 50
_RECORD = np.dtype(
    [("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")]
)


@dataclass(frozen=True)
class Part:
    """A part of a mesh, of one colour."""

    corners: np.ndarray
    """Of its triangles, in [m], shape (n, 3, 3)."""

    normals: np.ndarray
    """At the corners, shape (n, 3, 3)."""

    color: tuple[float, ...] | None
    """Red, green, blue, opacity from 0 to 1; None where the file gives none."""


@dataclass(frozen=True)
class Mesh:
    """A mesh that was found."""

    path: Path
    parts: tuple[Part, ...] = ()
    """Empty where PyBullet reads the file itself."""


_known: dict[tuple[Path, int, int], tuple[Part, ...] | str] = {}


def find_meshes(
    shapes: Iterable[Shape], package_folder: Callable[[str], str | None]
) -> dict[str, Mesh | str]:
    """Find the meshes of a model.

    Args:
        shapes: Its shapes; those that are no meshes are passed over.
        package_folder: Gives a package's folder, None if there is no such package.

    Returns:
        By their names as written: a mesh, or a clause that says why it is left out.
    """
    names = [shape.filename for shape in shapes if shape.kind == "mesh"]
    found: dict[str, Mesh | str] = {}
    unread: dict[str, tuple[Path, int, int]] = {}
    for name in dict.fromkeys(names):
        path = local_path(name, package_folder)
        if path is None:
            found[name] = f"mesh {name} does not exist"
        elif path.suffix.lower() not in KINDS:
            found[name] = f"mesh {name} is none of {', '.join(KINDS)}"
        elif is_binary_stl(path):
            found[name] = Mesh(path)
        else:
            status = path.stat()
            unread[name] = (path, status.st_size, status.st_mtime_ns)
    contents = _contents(list(dict.fromkeys(unread.values())))
    for name, key in unread.items():
        content = contents[key]
        if isinstance(content, str):
            found[name] = f"mesh {name} cannot be read" + (content and f": {content}")
        else:
            found[name] = Mesh(key[0], content)
    return found


def is_binary_stl(path: Path) -> bool:
    """Tell whether a file is a binary STL that PyBullet can be given.

    Such a file is as long as its number of triangles says; PyBullet computes that in
    32 bits and reads beyond the end.

    Args:
        path: An existing file.
    """
    try:
        size = path.stat().st_size
        with path.open("rb") as file:
            head = file.read(_STL_HEAD)
    except OSError:
        return False
    if path.suffix.lower() != ".stl" or len(head) < _STL_HEAD:
        return False
    (count,) = struct.unpack_from("<I", head, _STL_HEAD - 4)
    return bool(count > 0 and size == _STL_HEAD + count * _STL_TRIANGLE)


def binary_stl(corners: np.ndarray) -> bytes:
    """Write triangles so that PyBullet reads them.

    Args:
        corners: In [m], shape (n, 3, 3).
    """
    records = np.zeros(len(corners), _RECORD)
    records["corners"] = corners
    count = struct.pack("<I", len(corners))
    return bytes(_STL_HEAD - 4) + count + records.tobytes()


def _contents(
    keys: list[tuple[Path, int, int]],
) -> dict[tuple[Path, int, int], tuple[Part, ...] | str]:
    """Read files that were not read before, and remember what is in them."""
    late = {key: f"it took more than {PATIENCE:.0f} s" for key in keys}
    contents = {**late, **{key: _known[key] for key in keys if key in _known}}
    new = [key for key in keys if key not in _known]
    end = time.monotonic() + PATIENCE
    while new and time.monotonic() < end:
        results = _read([path for path, _, _ in new], end - time.monotonic())
        contents.update(zip(new, results))
        _known.update(zip(new, results))
        new = new[len(results) :]
    while len(_known) > MOST_KEPT:
        del _known[next(iter(_known))]
    return contents


def _read(paths: list[Path], patience: float) -> list[tuple[Part, ...] | str]:
    """Read files in a process of its own, up to the first that ends it.

    Args:
        paths: The files.
        patience: How long all of them may take, in [s].

    Returns:
        What is in the first files, or why they cannot be read; fewer than the one
        that ended it only when the time was over.
    """
    with tempfile.TemporaryDirectory() as folder:
        is_over = _run(folder, paths, patience)
        results: list[tuple[Part, ...] | str] = []
        for number in range(len(paths)):
            why_not, content = (Path(folder) / f"{number}{s}" for s in (".txt", ".npz"))
            if why_not.exists():
                results.append(why_not.read_text(encoding="utf-8"))
            elif content.exists():
                results.append(_parts(content))
            else:
                return [*results, ""] if is_over else results
    return results


def _run(folder: str, paths: Sequence[Path], patience: float) -> bool:
    """Run ``read_meshes``; tell whether it ended by itself.

    It runs in the folder of its results: of the folder that we run in Python would
    take modules first.
    """
    files = [os.path.abspath(path) for path in paths]
    try:
        subprocess.run(
            [sys.executable, "-m", f"{__package__}.read_meshes", folder, *files],
            cwd=folder,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            env={
                **os.environ,
                "PYTHONPATH": os.pathsep.join(sys.path),
                "OPENBLAS_NUM_THREADS": "1",
            },
            timeout=patience,
            check=False,
        )
    except subprocess.TimeoutExpired:
        return False
    return True


def _parts(content: Path) -> tuple[Part, ...]:
    """Take over what ``read_meshes`` read."""
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
