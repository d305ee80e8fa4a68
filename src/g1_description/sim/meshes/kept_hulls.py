"""Thinned hulls of earlier runs, in files.

Thinning the vendor's meshes takes half a second, and every start would do it again. The
files may come from another version of scipy: its hulls keep the tolerance as well.
"""

from __future__ import annotations

import hashlib
import io
import os
import zipfile
from contextlib import suppress
from pathlib import Path

import numpy as np

from g1_description.core.errors import InvalidValueError
from g1_description.core.files.atomic import write_whole

from . import hull_vertices

MAX_FILES = 1000
"""Most files that are kept; of usual meshes they have two or three kilobytes."""

READ_ERRORS = (
    *(OSError, EOFError, KeyError, ValueError, zipfile.BadZipFile),
    *(AttributeError, RuntimeError, TypeError),
)
"""What numpy raises of a file that was not written here, or not to the end."""

_METHOD = Path(hull_vertices.__file__).read_bytes()
"""The text of the code that thins: another one may choose other points."""


def thinned_once(points: np.ndarray, tolerance: float) -> tuple[np.ndarray, float]:
    """Thin a hull as `thinned` does, or take what that gave in an earlier run.

    Args:
        points: In any frame, in [m], shape (n, 3), always in the same order.
        tolerance: How far a point that is left out may be from the new hull, in [m].

    Returns:
        What `thinned` returns.
    """
    folder = hull_folder()
    if len(points) <= hull_vertices.MAX_WHOLE or not folder:
        return hull_vertices.thinned(points, tolerance)
    file = folder / f"{_key(points, tolerance)}.npz"
    kept = _read(file)
    if kept and _may_be_of(kept[0], points):
        return kept
    few, deviation = hull_vertices.thinned(points, tolerance)
    if few is points:  # they cannot be thinned
        return few, deviation
    content = io.BytesIO()
    np.savez(content, points=few, deviation=deviation)
    with suppress(InvalidValueError):  # a home that cannot be written is slower only
        write_whole(file, content.getvalue())
        _make_room(folder)
    return few, deviation


def hull_folder() -> Path | None:
    """Give the folder of the files, which need not exist; None without a home."""
    cache = os.environ.get("XDG_CACHE_HOME", "")
    if not os.path.isabs(cache):  # to be ignored, as the XDG specification has it
        cache = os.path.expanduser("~/.cache")
    return Path(cache, "g1_description", "hulls") if os.path.isabs(cache) else None


def _key(points: np.ndarray, tolerance: float) -> str:
    """Name what is thinned, and how."""
    key = hashlib.blake2b(_METHOD, digest_size=16)
    key.update(f" {tolerance!r} ".encode())
    key.update(points.tobytes())
    return key.hexdigest()


def _read(file: Path) -> tuple[np.ndarray, float] | None:
    """Read a thinned hull; None if there is none, or none that is whole."""
    try:
        # By its content, as numpy leaves a file open that it cannot read.
        with np.load(io.BytesIO(file.read_bytes()), allow_pickle=False) as arrays:
            return arrays["points"], float(arrays["deviation"])
    except READ_ERRORS:
        return None


def _may_be_of(few: np.ndarray, points: np.ndarray) -> bool:
    """Return whether an array can be some of these points."""
    return (
        few.dtype == points.dtype
        and few.shape[1:] == points.shape[1:]
        and 0 < len(few) < len(points)
    )


def _make_room(folder: Path) -> None:
    """Delete the oldest files, if there are too many."""
    with suppress(OSError):
        files = sorted(folder.iterdir(), key=lambda file: file.stat().st_mtime)
        for file in files[:-MAX_FILES]:
            file.unlink()
