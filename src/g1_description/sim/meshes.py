"""Meshes that PyBullet survives: its readers trust the numbers in a file."""

from __future__ import annotations

import struct
import subprocess
import sys
from collections.abc import Callable
from functools import lru_cache
from pathlib import Path

from ..core.resources import local_path

MESHES = (".dae", ".obj", ".stl")
"""What PyBullet reads; one file of another kind fails the whole load."""

PATIENCE = 5.0
"""Longest time that a trial may take, in [s]."""

_STL_HEAD, _STL_TRIANGLE = 84, 50

_TRIAL = """
import sys, pybullet
pybullet.connect(pybullet.DIRECT)
pybullet.createCollisionShape(pybullet.GEOM_MESH, fileName=sys.argv[1])
"""


def find_mesh(
    uri: str, package_folder: Callable[[str], str | None]
) -> tuple[Path | None, str]:
    """Find a mesh that PyBullet can be given.

    Args:
        uri: Where it lies: as written in the file.
        package_folder: Gives a package's folder, None if there is no such package.

    Returns:
        Its file; or None and a clause that says why it is left out.
    """
    path = local_path(uri, package_folder)
    if path is None:
        return None, f"mesh {uri} does not exist"
    if path.suffix.lower() not in MESHES:
        return None, f"mesh {uri} is none of {', '.join(MESHES)}"
    if not is_safe(path):
        return None, f"mesh {uri} cannot be read"
    return path, ""


def is_safe(path: Path) -> bool:
    """Tell whether PyBullet can be given a mesh.

    A binary STL is as long as its number of triangles says; PyBullet computes that
    in 32 bits and reads beyond the end. The others are read in a process of their
    own first, which may crash in place of the simulator.

    Args:
        path: An existing file.

    Returns:
        False if it cannot be read, or reading it would end the process.
    """
    try:
        status = path.stat()
        if path.suffix.lower() != ".stl":
            return _survives(str(path), status.st_size, status.st_mtime_ns)
        with path.open("rb") as file:
            head = file.read(_STL_HEAD)
    except OSError:
        return False
    if len(head) < _STL_HEAD:
        return False
    (count,) = struct.unpack_from("<I", head, _STL_HEAD - 4)
    return count > 0 and status.st_size == _STL_HEAD + count * _STL_TRIANGLE


@lru_cache(maxsize=1000)
def _survives(path: str, size: int, changed_ns: int) -> bool:
    """Read a mesh in a process of its own; once while it does not change."""
    try:
        trial = subprocess.run(
            [sys.executable, "-c", _TRIAL, path],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            timeout=PATIENCE,
            check=False,
        )
    except (subprocess.TimeoutExpired, ValueError):
        return False
    return trial.returncode == 0
