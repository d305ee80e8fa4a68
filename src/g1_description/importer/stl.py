"""STL: triangles in a file, binary or as text."""

from __future__ import annotations

import re

import numpy as np

from ..core.errors import DescriptionError
from ..core.surfaces import triangle_normals

_HEADER, _HEAD, _TRIANGLE = 80, 84, 50
_RECORD = np.dtype(
    [("normal", "<f4", 3), ("triangle", "<f4", (3, 3)), ("attribute", "<u2")]
)
_VERTEX = re.compile(rb"\bvertex\s+(\S+)\s+(\S+)\s+(\S+)", re.IGNORECASE)


def clean_stl(data: bytes) -> tuple[bytes, tuple[str, ...]]:
    """Write an STL file so that no reader takes it for what it is not.

    Readers tell the two kinds apart by the word "solid" at the beginning, by the
    length, or by both: what begins with "solid" must be text, and what is binary must
    be as long as its number of triangles says.

    Args:
        data: Content of the file.

    Returns:
        A binary STL with the same triangles, and what was changed.

    Raises:
        DescriptionError: If it has no triangles.
    """
    length = _binary_length(data)
    if len(data) != length and _VERTEX.search(data):
        return write_stl(_text_triangles(data)), ("text made binary",)
    if length <= _HEAD or len(data) < length:
        raise DescriptionError("it is cut short, empty or no STL")
    if not np.isfinite(read_stl(data)).all():
        raise DescriptionError("it has corners that are no numbers")
    changes = []
    header = data[:_HEADER]
    if header.lstrip().lower().startswith(b"solid"):
        header = re.sub(rb"(?i)solid", b"model", header, count=1)
        changes.append('header no longer begins with "solid"')
    if len(data) > length:
        changes.append(f"{len(data) - length} bytes behind the triangles cut off")
    return header + data[_HEADER:length], tuple(changes)


def read_stl(data: bytes) -> np.ndarray:
    """Read a binary STL.

    Args:
        data: What ``clean_stl`` gave.

    Returns:
        Corners of the triangles, in the unit of the file, shape (n, 3, 3).
    """
    count = (_binary_length(data) - _HEAD) // _TRIANGLE
    return np.frombuffer(data, _RECORD, count, _HEAD)["triangle"]


def write_stl(triangles: np.ndarray) -> bytes:
    """Write a binary STL.

    Args:
        triangles: Corners of the triangles, shape (n, 3, 3).

    Returns:
        Content of the file, with unit normals; zero where a triangle has no area.
    """
    records = np.zeros(len(triangles), _RECORD)
    records["normal"] = triangle_normals(triangles)
    records["triangle"] = triangles
    count = np.array(len(triangles), "<u4")
    return b"binary STL".ljust(_HEADER) + count.tobytes() + records.tobytes()


def _binary_length(data: bytes) -> int:
    """Tell how long a binary file with this beginning is."""
    if len(data) < _HEAD:
        return _HEAD
    return _HEAD + _TRIANGLE * int(np.frombuffer(data, "<u4", 1, _HEADER)[0])


def _text_triangles(data: bytes) -> np.ndarray:
    """Read the triangles of a text file, shape (n, 3, 3)."""
    try:
        corners = np.array(_VERTEX.findall(data)).astype(float)
    except ValueError as error:
        raise DescriptionError(f"it has a corner that is none: {error}") from error
    if len(corners) % 3 or not np.isfinite(corners).all():
        raise DescriptionError("its corners are not three to a triangle")
    return corners.reshape(-1, 3, 3)
