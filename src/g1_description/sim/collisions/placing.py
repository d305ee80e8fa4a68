"""Where shapes are relative to each other.

Sums are written out, as a matrix product of many rows may round otherwise than one of
few: a configuration has the same collisions to the last bit, whatever is checked
together with it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


def axes_of(q: np.ndarray) -> np.ndarray:
    """Convert quaternions to rotation matrices.

    Args:
        q: Unit quaternions (x, y, z, w), shape (n, 4).

    Returns:
        Matrices, shape (n, 3, 3).
    """
    x, y, z, w = q.T
    rows = [
        [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)],
        [2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)],
        [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)],
    ]
    return np.moveaxis(np.array(rows), 2, 0)


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


def place(
    a: np.ndarray, b: np.ndarray, poses_a: np.ndarray, poses_b: np.ndarray
) -> Placed:
    """Place shapes relative to others.

    Args:
        a: Indices of shapes, shape (n,).
        b: Likewise.
        poses_a: Poses of the links of the first in the world, shape (n, 7).
        poses_b: Poses of the links of the second, shape (n, 7).
    """
    ax, ay, az, aw = (poses_a[:, 3:] * np.array([-1.0, -1.0, -1.0, 1.0])).T
    bx, by, bz, bw = poses_b[:, 3:].T
    rotation = np.array(
        [
            aw * bx + ax * bw + ay * bz - az * by,
            aw * by + ay * bw + az * bx - ax * bz,
            aw * bz + az * bw + ax * by - ay * bx,
            aw * bw - ax * bx - ay * by - az * bz,
        ]
    ).T
    to_a = np.swapaxes(axes_of(poses_a[:, 3:]), 1, 2)
    origin = turn(to_a, poses_b[:, :3] - poses_a[:, :3])
    return Placed(a, b, axes_of(rotation), origin, rotation)
