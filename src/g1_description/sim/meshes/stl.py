"""Triangles: binary STL files, and surfaces of round shapes."""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

AROUND = 48
"""Segments of a full circle: the outline is 0.3 % too small."""


LEAST_NORMAL = 0.001
"""Least squared length of a valid normal."""


@dataclass(frozen=True)
class Surface:
    """Triangles with normals at their corners."""

    vertices: np.ndarray
    """In [m], shape (n, 3)."""

    normals: np.ndarray
    """Unit vectors outwards, shape (n, 3)."""

    triangles: np.ndarray
    """Rows of ``vertices``, anticlockwise seen from outside, shape (m, 3)."""


def triangle_normals(corners: np.ndarray) -> np.ndarray:
    """Compute the normals of triangles.

    Args:
        corners: Anticlockwise seen from outside, shape (n, 3, 3).

    Returns:
        Unit vectors, shape (n, 3); zero where a triangle has no area.
    """
    edges = np.diff(corners.astype(float), axis=1)
    normals = np.cross(edges[:, 0], edges[:, 1])
    lengths = np.linalg.norm(normals, axis=1, keepdims=True)
    return normals / np.where(lengths > 0.0, lengths, 1.0)


def has_direction(normals: np.ndarray) -> np.ndarray:
    """Return which normals, shape (..., 3), are long enough to have a direction."""
    with np.errstate(all="ignore"):
        squares = (normals.astype(float) ** 2).sum(axis=-1)
        return (squares >= LEAST_NORMAL) & (squares < np.inf)


def sphere(radius: float) -> Surface:
    """Make a sphere about the origin."""
    height = np.linspace(-np.pi / 2, np.pi / 2, AROUND // 2 + 1)
    outline = np.stack([np.cos(height), np.sin(height)], axis=-1)
    return _turned(radius * outline, outline)


def cylinder(radius: float, length: float) -> Surface:
    """Make a cylinder about the z axis, centred at the origin."""
    top = length / 2
    outline = [[0, -top], [radius, -top], [radius, -top], [radius, top]]
    outline += [[radius, top], [0, top]]
    normals = [[0, -1], [0, -1], [1, 0], [1, 0], [0, 1], [0, 1]]
    return _turned(np.array(outline), np.array(normals))


def capsule(radius: float, length: float) -> Surface:
    """Make a capsule about the z axis: a cylinder with half spheres at its ends."""
    height = np.linspace(0.0, np.pi / 2, AROUND // 4 + 1)
    top = np.stack([np.cos(height), np.sin(height)], axis=-1)
    normals = np.concatenate([top[::-1] * [1, -1], top])
    ends = np.repeat([[0.0, -length / 2], [0.0, length / 2]], len(top), axis=0)
    return _turned(radius * normals + ends, normals)


ROUND: dict[str, Callable[..., Surface]] = {
    "sphere": sphere,
    "cylinder": cylinder,
    "capsule": capsule,
}
"""Surfaces of round shapes by their kind, made from their size."""


def _turned(outline: np.ndarray, normals: np.ndarray) -> Surface:
    """Turn an outline, radius and height from below in [m], about the z axis."""
    angle = np.linspace(0.0, 2.0 * np.pi, AROUND + 1)
    n = np.arange(len(outline) * len(angle)).reshape(len(outline), len(angle))
    low, high = n[:-1], n[1:]
    corners = (
        (low[:, :-1], low[:, 1:], high[:, 1:]),
        (low[:, :-1], high[:, 1:], high[:, :-1]),
    )
    triangles = np.concatenate([np.stack(c, axis=-1).reshape(-1, 3) for c in corners])

    def around(pairs: np.ndarray) -> np.ndarray:
        across, along = pairs[:, :1], pairs[:, 1:]
        parts = across * np.cos(angle), across * np.sin(angle), along + 0.0 * angle
        return np.stack(parts, axis=-1).reshape(-1, 3)

    return Surface(around(outline), around(normals), triangles)


HEAD = 84
"""Bytes before the triangles: a header and their number."""

RECORD = np.dtype(
    [("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")]
)
"""A triangle."""

_HEADER = HEAD - 4


def triangle_count(head: bytes) -> int:
    """Return the number of triangles in the header of a binary file."""
    return int(np.frombuffer(head.ljust(HEAD, b"\0"), "<u4", 1, _HEADER)[0])


def binary_size(head: bytes) -> int:
    """Return the size in bytes according to the header of a binary file."""
    return HEAD + RECORD.itemsize * triangle_count(head)


def is_binary(data: bytes) -> bool:
    """Return whether the size of a file matches its number of triangles."""
    return len(data) == binary_size(data)


def clean_header(data: bytes) -> tuple[bytes, tuple[str, ...]]:
    """Change the header of a binary STL that looks like text.

    Readers distinguish the two kinds by the word "solid" at the beginning, by the
    length, or by both.

    Args:
        data: Content of the file.

    Returns:
        The new content, and messages on the change.
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
