"""Where shapes are relative to each other.

Sums are written out, as a matrix product of many rows may round otherwise than one of
few: a configuration has the same collisions to the last bit, whatever is checked
together with it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

# Entries of a rotation matrix, row by row: each has two products of the quaternion's
# parts, of which the second is added or subtracted.
_FIRST = np.array([[1, 0, 0, 0, 0, 1, 0, 1, 0], [1, 1, 2, 1, 0, 2, 2, 2, 0]])
_SECOND = np.array([[2, 3, 3, 3, 2, 3, 3, 3, 1], [2, 2, 1, 2, 2, 0, 1, 0, 1]])
_SIGN = np.array([1.0, -1.0, 1.0, 1.0, 1.0, -1.0, -1.0, 1.0, 1.0])
_DIAGONAL = [0, 4, 8]


def axes_of(q: np.ndarray) -> np.ndarray:
    """Convert quaternions to rotation matrices.

    Args:
        q: Unit quaternions (x, y, z, w), shape (n, 4).

    Returns:
        Matrices, shape (n, 3, 3).
    """
    first = q[:, _FIRST[0]] * q[:, _FIRST[1]]
    second = q[:, _SECOND[0]] * q[:, _SECOND[1]]
    entries = 2.0 * (first + _SIGN * second)
    entries[:, _DIAGONAL] = 1.0 - entries[:, _DIAGONAL]
    return entries.reshape(-1, 3, 3)


def turn(axes: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    """Apply rotation matrices, shape (n, 3, 3), to vectors, shape (n, 3)."""
    return (
        axes[:, :, 0] * vectors[:, :1]
        + axes[:, :, 1] * vectors[:, 1:2]
        + axes[:, :, 2] * vectors[:, 2:]
    )


@dataclass(frozen=True)
class Placed:
    """Pairs of shapes, the second placed in the link frame of the first."""

    a: np.ndarray
    b: np.ndarray
    """Indices of shapes, shape (n,)."""

    axes: np.ndarray
    """Rotation matrices that take coordinates of b's link to a's, shape (n, 3, 3)."""

    origin: np.ndarray
    """Origin of b's link in the frame of a's, in [m], shape (n, 3)."""

    rotation: np.ndarray
    """The same as ``axes``, as quaternions (x, y, z, w), shape (n, 4)."""

    def __getitem__(self, rows: np.ndarray | list[int]) -> Placed:
        """Select some of the pairs."""
        parts = (self.a, self.b, self.axes, self.origin, self.rotation)
        return Placed(*(part[rows] for part in parts))

    def swapped(self) -> Placed:
        """Return the same pairs with the first placed in the frame of the second."""
        axes = np.swapaxes(self.axes, 1, 2)
        conjugate = self.rotation * np.array([-1.0, -1.0, -1.0, 1.0])
        return Placed(self.b, self.a, axes, -turn(axes, self.origin), conjugate)


# Parts of a product of a conjugate and a quaternion, x, y, z, w: besides that with the
# first one's w, each is a sum of three products.
_LEFT = np.array([[0, 1, 2, 0], [1, 2, 0, 1], [2, 0, 1, 2]])
_RIGHT = np.array([[3, 3, 3, 0], [2, 0, 1, 1], [1, 2, 0, 2]])
_SIGNS = np.array([[-1.0, -1.0, -1.0, 1.0], [-1.0, -1.0, -1.0, 1.0], [1.0] * 4])


def place(
    a: np.ndarray,
    b: np.ndarray,
    poses_a: np.ndarray,
    poses_b: np.ndarray,
    axes_a: np.ndarray,
) -> Placed:
    """Place shapes relative to others.

    Args:
        a: Indices of shapes, shape (n,).
        b: Likewise.
        poses_a: Poses of the links of the first in the world, shape (n, 7).
        poses_b: Poses of the links of the second, shape (n, 7).
        axes_a: Rotations of the links of the first as matrices, shape (n, 3, 3).
    """
    q_a, q_b = poses_a[:, 3:], poses_b[:, 3:]
    rotation = q_a[:, 3:] * q_b
    for left, right, signs in zip(_LEFT, _RIGHT, _SIGNS):
        rotation += signs * (q_a[:, left] * q_b[:, right])
    origin = turn(np.swapaxes(axes_a, 1, 2), poses_b[:, :3] - poses_a[:, :3])
    return Placed(a, b, axes_of(rotation), origin, rotation)
