"""Which pairs of shapes may be near each other: spheres and boxes about them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from .convex_shapes import ConvexShape
from .placing import Placed


class Bounds:
    """A sphere and a box about each shape, in the frame of its link."""

    def __init__(self, shapes: Sequence[ConvexShape]) -> None:
        """Find the boxes."""
        boxes = [_box(shape) for shape in shapes]
        self._link = np.array([shape.link for shape in shapes], dtype=int)
        self._center = np.array([center for center, _, _ in boxes]).reshape(-1, 3)
        self._axes = np.array([axes for _, axes, _ in boxes]).reshape(-1, 3, 3)
        self._half = np.array([half for _, _, half in boxes]).reshape(-1, 3)
        self._radius = np.linalg.norm(self._half, axis=1)

    def near(
        self, T_world_link: np.ndarray, axes: np.ndarray, pairs: np.ndarray, gap: float
    ) -> tuple[np.ndarray, np.ndarray]:
        """Find the pairs whose spheres are near each other.

        Args:
            T_world_link: Poses of the links, shape (n_frames, n_links, 7).
            axes: The same rotations as matrices, shape (n_frames, n_links, 3, 3).
            pairs: Indices of shapes, shape (n_pairs, 2).
            gap: Pairs this far apart or farther are left out, in [m].

        Returns:
            Frames and rows of ``pairs``, shapes (n,).
        """
        turned = axes[:, self._link] @ self._center[:, :, np.newaxis]
        center = T_world_link[:, self._link, :3] + turned[..., 0]
        apart = center[:, pairs[:, 0]] - center[:, pairs[:, 1]]
        reach = self._radius[pairs].sum(axis=1) + gap
        squared = np.einsum("fpi,fpi->fp", apart, apart)
        frames, rows = np.nonzero(squared < reach**2)
        return frames, rows

    def overlap(self, placed: Placed, gap: float) -> np.ndarray:
        """Find the pairs that no side of their boxes separates.

        Args:
            placed: Pairs of shapes.
            gap: Pairs this far apart or farther are left out, in [m].

        Returns:
            Rows of ``placed``, shape (n,).
        """
        a, b = placed.a, placed.b
        axes_a, axes_b = self._axes[a], placed.axes @ self._axes[b]
        center_b = (placed.axes @ self._center[b][:, :, np.newaxis])[..., 0]
        apart = (placed.origin + center_b - self._center[a])[:, np.newaxis]
        slopes = np.abs(np.swapaxes(axes_a, 1, 2) @ axes_b)
        half_a, half_b = self._half[a][:, np.newaxis], self._half[b][:, np.newaxis]
        reach_b = (slopes @ np.swapaxes(half_b, 1, 2))[..., 0]
        along_a = np.abs(apart @ axes_a)[:, 0] - half_a[:, 0] - reach_b
        along_b = np.abs(apart @ axes_b)[:, 0] - half_b[:, 0] - (half_a @ slopes)[:, 0]
        return np.flatnonzero(np.maximum(along_a, along_b).max(axis=1) < gap)


def _box(shape: ConvexShape) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Find the smaller of two boxes: along the link's axes, or the principal ones.

    Returns:
        Its centre, shape (3,), its axes as columns, shape (3, 3), and half its sides,
        shape (3,), in the link frame, in [m].
    """
    centered = shape.points - shape.points.mean(axis=0)
    boxes = []
    for axes in (np.eye(3), np.linalg.svd(centered.T @ centered)[0]):
        along = shape.points @ axes
        low, high = along.min(axis=0) - shape.radius, along.max(axis=0) + shape.radius
        boxes.append((axes @ (low + high) / 2.0, axes, (high - low) / 2.0))
    return min(boxes, key=lambda box: float(np.prod(box[2])))
