"""STL: triangles in a binary file."""

from __future__ import annotations

import re

import numpy as np

from .surfaces import triangle_normals

HEAD = 84
"""Bytes before the triangles: a header and their number."""

RECORD = np.dtype(
    [("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")]
)
"""A triangle."""

_HEADER = HEAD - 4


def triangle_count(head: bytes) -> int:
    """Return how many triangles a binary file has by its beginning."""
    return int(np.frombuffer(head.ljust(HEAD, b"\0"), "<u4", 1, _HEADER)[0])


def binary_size(head: bytes) -> int:
    """Return how many bytes a binary file has by its beginning."""
    return HEAD + RECORD.itemsize * triangle_count(head)


def is_binary(data: bytes) -> bool:
    """Return whether a file is as long as its number of triangles says."""
    return len(data) == binary_size(data)


def clean_header(data: bytes) -> tuple[bytes, tuple[str, ...]]:
    """Write a binary STL so that no reader takes it for text.

    Readers distinguish the two kinds by the word "solid" at the beginning, by the
    length, or by both.

    Args:
        data: Content of the file.

    Returns:
        The same with another header, and what was changed.
    """
    header = data[:_HEADER]
    if not header.lstrip().lower().startswith(b"solid"):
        return data, ()
    header = re.sub(rb"(?i)solid", b"model", header, count=1)
    return header + data[_HEADER:], ('header no longer begins with "solid"',)


def read_stl(data: bytes) -> np.ndarray:
    """Read a binary STL.

    Args:
        data: Content of the file.

    Returns:
        Corners of the triangles, in the unit of the file, shape (n, 3, 3).
    """
    return np.frombuffer(data, RECORD, offset=HEAD)["corners"]


def write_stl(triangles: np.ndarray) -> bytes:
    """Write a binary STL.

    Args:
        triangles: Corners of the triangles, shape (n, 3, 3).

    Returns:
        Content of the file, with unit normals; zero where a triangle has no area.
    """
    records = np.zeros(len(triangles), RECORD)
    records["normal"] = triangle_normals(triangles)
    records["corners"] = triangles
    count = np.array(len(triangles), "<u4")
    return b"binary STL".ljust(_HEADER) + count.tobytes() + records.tobytes()
