"""Whether PyBullet survives a mesh: its readers trust the numbers in a file."""

from __future__ import annotations

import struct
import subprocess
import sys
from functools import lru_cache
from pathlib import Path

PATIENCE = 5.0
"""Longest time that a trial may take, in [s]."""

_STL_HEAD, _STL_TRIANGLE = 84, 50

_TRIAL = """
import sys, pybullet
pybullet.connect(pybullet.DIRECT)
pybullet.createCollisionShape(pybullet.GEOM_MESH, fileName=sys.argv[1])
"""


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
