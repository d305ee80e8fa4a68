"""How one configuration stands: ``Ground.frames`` of a single sample at rest.

All points are placed at once, which for one sample takes a third of the time.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from g1_description.core.checks.thresholds import Thresholds
from g1_description.core.rotation import to_axes

from .frames import GroundFrames, Outline


class GroundAtRest:
    """The points of a robot's outlines above a floor."""

    def __init__(
        self, outlines: Sequence[Outline], ends: np.ndarray, thresholds: Thresholds
    ) -> None:
        """Prepare.

        Args:
            outlines: Of the links.
            ends: Which links carry none that moves against them, shape (n_links,).
            thresholds: Where the floor is, and how near a point bears.
        """
        rows = sorted({outline.row for outline in outlines})
        column = {row: number for number, row in enumerate(rows)}
        counts = [len(outline.points) for outline in outlines]
        self._thresholds = thresholds
        self._is_end = ends[np.array(rows, dtype=int)]
        self._link = np.array([outline.row for outline in outlines], dtype=int)
        self._column = np.array([column[row] for row in self._link], dtype=int)
        self._radius = np.array([outline.radius for outline in outlines])
        self._reach = np.array([outline.reach for outline in outlines])
        self._points = np.concatenate(
            [np.zeros((0, 3)), *(outline.points for outline in outlines)]
        )
        self._outline = np.repeat(np.arange(len(outlines)), counts)
        self._begin = np.concatenate([[0], np.cumsum(counts)]).astype(int)

    def frame(self, link_poses: np.ndarray) -> GroundFrames:
        """Find how the robot stands.

        Args:
            link_poses: Poses of all links in the map, shape (1, n_links, 7).
        """
        limits, poses = self._thresholds, link_poses[0, self._link]
        shape = (1, len(self._is_end))
        heights, lowest = np.full(shape, np.inf), np.zeros((*shape, 3))
        z, axes = poses[:, 2] - limits.floor_height, to_axes(poses[:, 3:])
        up, offset = axes[:, 2].take(self._outline, 0), z - self._radius
        height = np.einsum("ij,ij->i", self._points, up) + offset.take(self._outline)
        nearest = max((z + self._reach).min(initial=np.inf), limits.bearing_height)
        found: dict[int, int] = {}
        for number in np.flatnonzero(z - self._reach <= nearest).tolist():
            begin, end = self._begin[number], self._begin[number + 1]
            at = begin + int(height[begin:end].argmin())
            column = self._column[number]
            if height[at] < heights[0, column]:
                heights[0, column] = height[at]
                found[column] = at
        columns, points = [*found], np.array([*found.values()], dtype=int)
        lowest[0, columns, :2] = self._place(axes, poses, points)
        lowest[0, columns, 2] = height[points] + limits.floor_height
        bears = heights <= limits.contact_height
        bears |= self._is_end & (heights <= limits.bearing_height)
        low = np.flatnonzero(height <= limits.bearing_height)
        low = low[bears[0, self._column[self._outline[low]]]]
        support = self._place(axes, poses, low)
        every = np.arange(shape[1])
        return GroundFrames(every, heights, lowest, np.zeros(shape), bears, [support])

    def _place(
        self, axes: np.ndarray, poses: np.ndarray, points: np.ndarray
    ) -> np.ndarray:
        """Place points along the map's x and y.

        Args:
            axes: Axes of the outlines' links in the map, shape (n_outlines, 3, 3).
            poses: Poses of these links, shape (n_outlines, 7).
            points: Indices of points, shape (k,).

        Returns:
            In [m], shape (k, 2).
        """
        outline, points = self._outline[points], self._points[points]
        turned = (axes[outline, :2] @ points[:, :, np.newaxis])[..., 0]
        return np.asarray(poses[outline, :2] + turned)
