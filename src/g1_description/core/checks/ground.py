"""The robot and the floor: what bears, sinks in, floats or slides."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from g1_description.core.dynamics.masses import GRAVITY
from g1_description.core.motion.sampling import SNAP
from g1_description.core.rotation import cross, to_axes

from .thresholds import Thresholds
from .verdict import Fault, intervals

FREE_FALL = 0.5
"""Share of gravity from which on a robot in the air falls, instead of floating."""

SLIDE_WINDOW = 0.1
"""Over how long a sliding link's speed is averaged, in [s]."""

SHORTEST_FLIGHT = 0.1
"""A robot in the air for a shorter time is not judged, in [s]: its acceleration cannot
be told from noise."""


@dataclass(frozen=True, eq=False)
class Outline:
    """Points, and a radius about them, whose convex hull is a part of a link."""

    row: int
    """Of the link."""

    points: np.ndarray
    """In the link frame, in [m], shape (k, 3)."""

    radius: float

    @property
    def reach(self) -> float:
        """How far it is from the link's origin at most, in [m]."""
        return float(np.linalg.norm(self.points, axis=1).max()) + self.radius


@dataclass(frozen=True, eq=False)
class GroundFrames:
    """How a robot stands, at each of some samples.

    Links are those with an outline, in the order of ``Ground.rows``.
    """

    heights: np.ndarray
    """Of the lowest point of each link above the floor, in [m], shape (n, n_links); of
    a link that is neither the lowest one nor near the floor a lower bound."""

    lowest: np.ndarray
    """That point, in the map, in [m], shape (n, n_links, 3)."""

    slide: np.ndarray
    """How fast that point of the link moves along the floor, in [m/s], shape
    (n, n_links)."""

    bears: np.ndarray
    """Whether a link touches the floor, or is slow and almost on it, shape
    (n, n_links)."""

    support: list[np.ndarray]
    """Points that bear, along the map's x and y, in [m], shape (k, 2) per sample."""

    @staticmethod
    def joined(parts: Sequence[GroundFrames]) -> GroundFrames:
        """Chain the frames of successive samples."""
        return GroundFrames(
            np.concatenate([part.heights for part in parts]),
            np.concatenate([part.lowest for part in parts]),
            np.concatenate([part.slide for part in parts]),
            np.concatenate([part.bears for part in parts]),
            [points for part in parts for points in part.support],
        )


class Ground:
    """A robot's outlines above a floor."""

    def __init__(
        self, outlines: Sequence[Outline], ends: np.ndarray, thresholds: Thresholds
    ) -> None:
        """Prepare.

        Args:
            outlines: Of the links.
            ends: Which links carry none that moves against them, shape (n_links,): feet
                and hands. Only these bear without touching the floor.
            thresholds: Where the floor is, and how near a point bears.
        """
        self.rows = np.array(sorted({outline.row for outline in outlines}), dtype=int)
        self._outlines = outlines
        self._is_end = ends[self.rows]
        self._outline_rows = [outline.row for outline in outlines]
        self._reaches = np.array([outline.reach for outline in outlines])
        self._column = {row: column for column, row in enumerate(self.rows)}
        self._thresholds = thresholds

    def frames(self, link_poses: np.ndarray, link_twists: np.ndarray) -> GroundFrames:
        """Find how the robot stands.

        Args:
            link_poses: Poses of all links in the map, shape (n, n_links, 7).
            link_twists: Twists of their origins along the map's axes, shape
                (n, n_links, 6).
        """
        shape = (len(link_poses), len(self.rows))
        heights, lowest = np.full(shape, np.inf), np.zeros((*shape, 3))
        low = [(np.zeros((2, 0), dtype=int), np.zeros((0, 2)))]
        near = self._near(link_poses)
        for number in np.flatnonzero(near.any(axis=1)):
            outline, at = self._outlines[number], np.flatnonzero(near[number])
            column = self._column[outline.row]
            points = self._points(outline, link_poses[at, outline.row])
            best = points[..., 2].argmin(axis=1)
            lowest_points = points[np.arange(len(at)), best]
            is_lower = lowest_points[:, 2] < heights[at, column]
            changed = at[is_lower]
            heights[changed, column] = lowest_points[is_lower, 2]
            lowest[changed, column] = lowest_points[is_lower]
            is_low = points[..., 2] <= self._thresholds.bearing_height
            frame = at[np.nonzero(is_low)[0]]
            owner = np.stack([frame, np.full_like(frame, column)])
            low.append((owner, points[is_low][:, :2]))
        velocity = self._velocity(link_poses, link_twists, lowest)
        bears = self._bears(heights, np.linalg.norm(velocity, axis=-1))
        slide = np.hypot(velocity[..., 0], velocity[..., 1])
        lowest[..., 2] += self._thresholds.floor_height
        return GroundFrames(heights, lowest, slide, bears, _support(low, bears))

    def _bears(self, heights: np.ndarray, speed: np.ndarray) -> np.ndarray:
        """Tell which links bear, from their lowest points."""
        is_slow = (speed < self._thresholds.bearing_speed) & self._is_end
        touches = heights <= self._thresholds.contact_height
        return touches | (is_slow & (heights <= self._thresholds.bearing_height))

    def _near(self, link_poses: np.ndarray) -> np.ndarray:
        """Mark where outlines may be the lowest, or near the floor.

        Returns:
            Shape (n_outlines, n_samples).
        """
        z = link_poses[:, self._outline_rows, 2].T - self._thresholds.floor_height
        reach = self._reaches[:, np.newaxis]
        highest = np.maximum((z + reach).min(axis=0), self._thresholds.bearing_height)
        return np.asarray(z - reach <= highest)

    def _points(self, outline: Outline, poses: np.ndarray) -> np.ndarray:
        """Place the lowest points of an outline, relative to the floor.

        Returns:
            Shape (n, k, 3).
        """
        points = outline.points @ np.swapaxes(to_axes(poses[:, 3:]), 1, 2)
        points += poses[:, np.newaxis, :3]
        points[..., 2] -= outline.radius + self._thresholds.floor_height
        return points

    def _velocity(
        self, poses: np.ndarray, twists: np.ndarray, lowest: np.ndarray
    ) -> np.ndarray:
        """Compute how the lowest points of the links move, shape (n, n_links, 3)."""
        origin, twist = poses[:, self.rows, :3].copy(), twists[:, self.rows]
        origin[..., 2] -= self._thresholds.floor_height
        return np.asarray(twist[..., :3] + cross(twist[..., 3:], lowest - origin))

    def bearing(self, frames: GroundFrames, times: np.ndarray) -> np.ndarray:
        """Tell which links bear for long enough, shape (n, n_links).

        Args:
            frames: At successive samples.
            times: Of the samples in [s], shape (n,).
        """
        bears = frames.bears.copy()
        if len(times) == 1:
            return bears
        for column in np.flatnonzero(bears.any(axis=0)):
            for first, last in intervals(times, bears[:, column]):
                if last - first < self._thresholds.shortest_contact:
                    bears[(times >= first) & (times <= last), column] = False
        return bears


def _support(
    low: Sequence[tuple[np.ndarray, np.ndarray]], bears: np.ndarray
) -> list[np.ndarray]:
    """Sort the low points of bearing links by the sample that they belong to.

    Args:
        low: Samples and links of points, shape (2, k), and the points, shape (k, 2).
        bears: Which links bear, shape (n, n_links).
    """
    frame, column = np.concatenate([owner for owner, _ in low], axis=1)
    points = np.concatenate([part for _, part in low])
    is_kept = bears[frame, column]
    frame, points = frame[is_kept], points[is_kept]
    order = np.argsort(frame, kind="stable")
    ends = np.searchsorted(frame[order], np.arange(1, len(bears)))
    return np.split(points[order], ends)


def sliding_speeds(
    slide: np.ndarray, touches: np.ndarray, times: np.ndarray
) -> np.ndarray:
    """Average how fast links slide, as long as they touch the floor.

    A foot that is put down or lifted moves a little on its last millimetres, which
    counts together with the time that it stands.

    Args:
        slide: Speeds of lowest points along the floor, in [m/s], shape (n, n_links).
        touches: Where they touch the floor, shape (n, n_links).
        times: Of the samples in [s], shape (n,).

    Returns:
        Means over ``SLIDE_WINDOW``, or the whole time of contact where that is shorter,
        in [m/s]; NaN where a link does not touch, shape (n, n_links).
    """
    found = np.full(slide.shape, np.nan)
    for column in np.flatnonzero(touches.any(axis=0)):
        for first, last in intervals(times, touches[:, column]):
            rows = np.flatnonzero((times >= first) & (times <= last))
            inside = times[rows]
            summed = np.append(0.0, np.cumsum(slide[rows, column]))
            latest = max(first, last - SLIDE_WINDOW)
            start = np.clip(inside - SLIDE_WINDOW / 2.0, first, latest)
            begin = np.searchsorted(inside, start - SNAP, side="left")
            end = np.searchsorted(inside, start + SLIDE_WINDOW + SNAP, side="right")
            found[rows, column] = (summed[end] - summed[begin]) / (end - begin)
    return found


def ground_faults(
    names: Sequence[str],
    frames: GroundFrames,
    bears: np.ndarray,
    slides: np.ndarray,
    airborne: np.ndarray,
) -> list[Fault]:
    """Find what is wrong with a robot on its floor.

    Args:
        names: Of the links with outlines.
        frames: How it stands at each sample.
        bears: Which links bear, shape (n, n_links).
        slides: How fast links slide that touch the floor, shape (n, n_links).
        airborne: What ``float_heights`` returned, shape (n,).

    Returns:
        Depths of links in the floor, heights and speeds of those that bear, and the
        height of a robot that floats.
    """
    faults = []
    for column in np.flatnonzero(frames.bears.any(axis=0)):
        link, heights = (names[column],), frames.heights[:, column]
        points = frames.lowest[:, column]
        text = f"{link[0]} is {{worst:.4g}} m deep in the floor at {{time:.3f}} s"
        faults.append(Fault("penetration", link, -heights, "m", text, points))
        text = f"{link[0]} slides on the floor with {{worst:.4g}} m/s at {{time:.3f}} s"
        faults.append(Fault("skating", link, slides[:, column], "m/s", text, points))
        high = np.where(bears[:, column], heights, np.nan)
        text = f"{link[0]} bears {{worst:.4g}} m above the floor at {{time:.3f}} s"
        faults.append(Fault("floating", link, high, "m", text, points))
    text = "the robot floats {worst:.4g} m above the floor at {time:.3f} s"
    lowest = np.argmin(frames.heights, axis=1)
    points = frames.lowest[np.arange(len(lowest)), lowest]
    faults.append(Fault("floating", (), airborne, "m", text, points))
    return faults


def float_heights(
    heights: np.ndarray,
    center_heights: np.ndarray,
    times: np.ndarray,
    bearing_height: float,
) -> np.ndarray:
    """Find how high a robot floats, which is in the air and does not fall.

    Args:
        heights: Of its lowest point above the floor in [m], shape (n,).
        center_heights: Of its centre of mass in [m], shape (n,).
        times: Of the samples in [s], shape (n,).
        bearing_height: Up to which it bears, in [m].

    Returns:
        The heights; NaN where it bears or falls, shape (n,).
    """
    floats = np.full(len(times), np.nan)
    in_air = heights > bearing_height
    if len(times) == 1:
        return np.where(in_air, heights, np.nan)
    for first, last in intervals(times, in_air):
        rows = (times >= first) & (times <= last)
        if last - first >= SHORTEST_FLIGHT and rows.sum() > 2:
            curve = np.polyfit(times[rows] - first, center_heights[rows], 2)[0]
            if 2.0 * curve > -FREE_FALL * GRAVITY:
                floats[rows] = heights[rows]
    return floats
