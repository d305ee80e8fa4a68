"""A robot above a floor: heights, contacts and points of support."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from g1_description.checks.ground_samples import GroundPiece, GroundSamples
from g1_description.checks.intervals import runs, without_short
from g1_description.checks.surfaces import Surfaces
from g1_description.checks.thresholds import Thresholds
from g1_description.collisions.convex_shapes import ConvexShape
from g1_description.motion.motion import SNAP
from g1_description.robot.rotation import conjugate, cross, multiply, rotate, to_axes

SLIDE_WINDOW = 0.1
"""Time over which a sliding link's speed is averaged, in [s]."""


SETTLED = 1e-5
"""A link that sinks less than this until the next sample, in [m], is set down."""

HYSTERESIS = 2.0
"""A contact ends at this multiple of ``support_speed``, below which it begins."""


class Lowest(NamedTuple):
    """The lowest points of links, and all that may support the robot."""

    heights: np.ndarray
    """Of the lowest points, in [m], shape (n, n_links)."""

    points: np.ndarray
    """The lowest points, heights relative to the floor, shape (n, n_links, 3)."""

    below: np.ndarray | None
    """Rows of the objects below them, shape (n, n_links)."""

    owner: np.ndarray
    """Samples and columns of low points, shape (2, k)."""

    low: np.ndarray
    """Low points, heights relative to the floor, shape (k, 3)."""

    low_heights: np.ndarray
    """Their heights above what is below, shape (k,)."""


class Ground:
    """A robot's outlines above a floor."""

    def __init__(
        self,
        outlines: Sequence[ConvexShape],
        ends: np.ndarray,
        thresholds: Thresholds,
        edges: Sequence[ConvexShape] = (),
    ) -> None:
        """Prepare.

        Args:
            outlines: Convex parts of the links.
            ends: Whether a link is the end of a limb, such as a foot or hand, shape
                (n_links,). Only these support the robot without touching the floor.
            thresholds: Heights and speeds of contacts.
            edges: More points of the outlines, for those that are above objects.
        """
        self._n_outlines = len(outlines)
        outlines = [*outlines, *edges]
        self._outlines = outlines
        self._outline_rows = [outline.link for outline in outlines]
        self.rows = np.array(sorted({*self._outline_rows}), dtype=int)
        self._is_end = ends[self.rows]
        distances = [np.linalg.norm(outline.points, axis=1) for outline in outlines]
        self._reaches = np.array(
            [float(far.max()) + part.radius for far, part in zip(distances, outlines)]
        )
        self._column = {row: column for column, row in enumerate(self.rows)}
        self._thresholds = thresholds

    def piece(
        self,
        link_poses: np.ndarray,
        link_twists: np.ndarray,
        surfaces: Surfaces | None = None,
    ) -> GroundPiece:
        """Find where links are above the floor.

        Args:
            link_poses: Poses of all links in the map, shape (n, n_links, 7).
            link_twists: Twists of their origins along the map's axes, shape
                (n, n_links, 6).
            surfaces: What counts as floor, too.
        """
        shape, limits = (len(link_poses), len(self.rows)), self._thresholds
        heights, lowest, below, owner, points, low_heights = self._lowest(
            link_poses, surfaces
        )
        velocity = self._velocity(link_poses, link_twists, lowest, np.indices(shape))
        point_velocity = self._velocity(link_poses, link_twists, points, owner)
        touching = low_heights <= heights[tuple(owner)] + limits.contact_height
        means = _means(
            _averaged(velocity, lowest),
            _averaged(point_velocity[touching], points[touching]),
            owner[:, touching],
        )
        lowest[..., 2] += limits.floor_height
        speed = np.linalg.norm(velocity, axis=-1)
        is_used = heights <= limits.support_height
        is_used[np.arange(len(heights)), heights.argmin(axis=1)] = True
        used = np.flatnonzero(is_used.any(axis=0))
        slide, moves, place = np.split(means[:, used], (1, 3), axis=-1)
        place = np.concatenate([place, lowest[:, used, 2:]], axis=-1)
        return GroundPiece(
            used,
            heights,
            lowest[:, used],
            slide[..., 0],
            moves,
            _steps(link_poses[:, self.rows[used]], place),
            speed[:, used],
            owner,
            points + np.array([0.0, 0.0, limits.floor_height]),
            low_heights,
            None if below is None else below[:, used],
            None if below is None else _levels(owner[0], points, low_heights, shape[0]),
        )

    def _lowest(self, link_poses: np.ndarray, surfaces: Surfaces | None) -> Lowest:
        """Find the lowest point of each link, and all points that may support it."""
        shape, limits = (len(link_poses), len(self.rows)), self._thresholds
        heights, lowest = np.full(shape, np.inf), np.zeros((*shape, 3))
        below = None if surfaces is None else np.full(shape, -1)
        owners, low = [np.zeros((2, 0), dtype=int)], [np.zeros((0, 3))]
        low_heights = [np.zeros(0)]
        near = self._near(link_poses, surfaces)
        for number in np.flatnonzero(near.any(axis=1)):
            outline, at = self._outlines[number], np.flatnonzero(near[number])
            column = self._column[outline.link]
            points = self._points(outline, link_poses[at, outline.link])
            above = points[..., 2]
            if surfaces is not None:
                level, objects = surfaces.below(points)
                above = above - level
            best = above.argmin(axis=1)
            least = above[np.arange(len(at)), best]
            is_lower = least < heights[at, column]
            changed, rows = at[is_lower], np.flatnonzero(is_lower)
            heights[changed, column] = least[is_lower]
            lowest[changed, column] = points[rows, best[rows]]
            if below is not None:
                below[changed, column] = objects[rows, best[rows]]
            is_low = above <= limits.support_height
            if surfaces is not None and number >= self._n_outlines:
                is_part = (level != level[:, :1]).any(axis=1, keepdims=True)
                is_low &= (objects >= 0) & is_part
            sample = at[np.nonzero(is_low)[0]]
            owners.append(np.stack([sample, np.full_like(sample, column)]))
            low.append(points[is_low])
            low_heights.append(above[is_low])
        owner, points = np.concatenate(owners, axis=1), np.concatenate(low)
        above = np.concatenate(low_heights)
        return Lowest(heights, lowest, below, owner, points, above)

    def _near(self, link_poses: np.ndarray, surfaces: Surfaces | None) -> np.ndarray:
        """Mark where outlines may be the lowest, or near the floor.

        Returns:
            Shape (n_outlines, n_samples).
        """
        z = link_poses[:, self._outline_rows, 2].T - self._thresholds.floor_height
        reach = self._reaches[:, np.newaxis]
        highest = np.maximum((z + reach).min(axis=0), self._thresholds.support_height)
        near = np.asarray(z - reach <= highest)
        if surfaces is not None:
            centers = np.swapaxes(link_poses[:, self._outline_rows, :3], 0, 1).copy()
            centers[..., 2] = z
            reaches = self._reaches + self._thresholds.support_height
            reached = surfaces.reached(centers, reaches)
            near[: self._n_outlines] |= reached[: self._n_outlines]
            near[self._n_outlines :] = reached[self._n_outlines :]
        return near

    def _points(self, outline: ConvexShape, poses: np.ndarray) -> np.ndarray:
        """Place the lowest points of an outline, relative to the floor.

        Returns:
            Shape (n, k, 3).
        """
        points = outline.points @ np.swapaxes(to_axes(poses[:, 3:]), 1, 2)
        points += poses[:, np.newaxis, :3]
        points[..., 2] -= outline.radius + self._thresholds.floor_height
        return points

    def _velocity(
        self, poses: np.ndarray, twists: np.ndarray, points: np.ndarray, at: np.ndarray
    ) -> np.ndarray:
        """Compute how points of links move.

        Args:
            poses: Poses of all links, shape (n, n_links, 7).
            twists: Twists of their origins, shape (n, n_links, 6).
            points: In the map, heights above the floor, shape (..., 3).
            at: Samples and columns of their links, shape (2, ...).
        """
        sample, row = at[0], self.rows[at[1]]
        origin, twist = poses[sample, row, :3], twists[sample, row]
        origin[..., 2] -= self._thresholds.floor_height
        return np.asarray(twist[..., :3] + cross(twist[..., 3:], points - origin))

    def samples(
        self, pieces: Sequence[GroundPiece], times: np.ndarray
    ) -> GroundSamples:
        """Find how the robot stands.

        Args:
            pieces: Pieces of successive samples.
            times: Times of the samples in [s], shape (n,).
        """
        columns = np.unique(np.concatenate([piece.columns for piece in pieces]))
        heights = np.concatenate([piece.heights[:, columns] for piece in pieces])
        firsts = np.cumsum([0, *(len(piece.heights) for piece in pieces[:-1])])
        offsets = [np.array([[first], [0]]) for first in firsts]
        moved = [piece.low + offset for piece, offset in zip(pieces, offsets)]
        low = np.concatenate(moved, axis=1)
        low[1] = np.searchsorted(columns, low[1])
        lowest, slide, moves, steps, speed = (
            _spread(pieces, name, columns)
            for name in ("lowest", "slide", "moves", "steps", "speed")
        )
        gaps = np.diff(times, append=times[-1])[:, np.newaxis, np.newaxis]
        steps = np.where(np.isnan(steps), gaps * moves, steps)
        in_contact = self._contacts(heights, speed, times, self._is_end[columns])
        order = np.argsort(low[0], kind="stable")
        points, above = (
            np.concatenate([getattr(piece, name) for piece in pieces])[order]
            for name in ("low_points", "low_heights")
        )
        below = level = None
        if pieces[0].below is not None:
            below, level = (
                _spread(pieces, "below", columns, -1),
                np.concatenate([piece.level for piece in pieces]),
            )
        collides = np.zeros_like(in_contact)
        return GroundSamples(
            columns,
            heights,
            lowest,
            slide,
            steps,
            in_contact,
            low[:, order],
            points,
            above,
            below,
            level,
            collides,
        )

    def _contacts(
        self,
        heights: np.ndarray,
        speed: np.ndarray,
        times: np.ndarray,
        is_end: np.ndarray,
    ) -> np.ndarray:
        """Find the links that support the robot, shape (n, n_links).

        Args:
            heights: Heights of the links' lowest points in [m], shape (n, n_links).
            speed: Speed of these points in [m/s], shape (n, n_links).
            times: Times of the samples in [s], shape (n,).
            is_end: Whether a link is the end of a limb, shape (n_links,).
        """
        limits = self._thresholds
        touches = heights <= limits.contact_height
        is_near = (heights <= limits.support_height) & is_end
        if len(times) == 1:
            return touches | is_near
        in_contact = touches | (is_near & (speed < limits.support_speed))
        may_stay = touches | (is_near & (speed < HYSTERESIS * limits.support_speed))
        for column in np.flatnonzero(in_contact.any(axis=0)):
            stood = in_contact[:, column]
            for first, last in runs(may_stay[:, column]):
                if stood[first : last + 1].any():
                    stood[first : last + 1] = True
            for first, last in runs(~stood):
                is_between = first > 0 and last < len(times) - 1
                is_short = times[last] - times[first] < limits.shortest_contact
                if is_between and is_short and is_near[first : last + 1, column].all():
                    stood[first : last + 1] = True
            _trim_steps(stood, heights[:, column], touches[:, column])
            stood[:] = without_short(times, stood, limits.shortest_contact)
        return in_contact

    def lonely(self, samples: GroundSamples, times: np.ndarray) -> np.ndarray:
        """Mark the lowest foot or hand near the floor while none supports the robot.

        Args:
            samples: How the robot stands.
            times: Times of the samples in [s], shape (n,).

        Returns:
            Shape (n, n_links).
        """
        heights = samples.heights
        lowest = heights <= heights.min(axis=1, keepdims=True)
        lowest &= self._is_end[samples.columns]
        lowest &= heights <= self._thresholds.support_height
        is_lonely = lowest.any(axis=1) & ~samples.in_contact.any(axis=1)
        is_lonely = without_short(times, is_lonely, SLIDE_WINDOW)
        return np.asarray(lowest & is_lonely[:, np.newaxis])

    def sliding(
        self, samples: GroundSamples, times: np.ndarray, is_unknown: np.ndarray
    ) -> np.ndarray:
        """Compute the speeds of links that slide on the floor.

        Only links that touch the floor and support the robot slide. If no link supports
        a robot that is close to the floor for long, its lowest foot or hand does.

        Args:
            samples: How the robot stands.
            times: Times of the samples in [s], shape (n,).
            is_unknown: Where velocities are not usable, shape (n,).

        Returns:
            Means over ``SLIDE_WINDOW``, or the whole contact where that is shorter, in
            [m/s]; NaN where a link does not touch the floor, shape (n, n_links). A foot
            moves a little in the last millimetres before it touches down, so means
            include the time that it stands.
        """
        heights, limits = samples.heights, self._thresholds
        touches = samples.in_contact & (heights <= limits.contact_height)
        touches |= self.lonely(samples, times)
        touches &= ~is_unknown[:, np.newaxis]
        found = np.full(touches.shape, np.nan)
        for column in np.flatnonzero(touches.any(axis=0)):
            for first, last in runs(touches[:, column]):
                rows = slice(first, last + 1)
                inside = times[rows]
                summed = np.append(0.0, np.cumsum(samples.slide[rows, column]))
                latest = max(inside[0], inside[-1] - SLIDE_WINDOW)
                start = np.clip(inside - SLIDE_WINDOW / 2.0, inside[0], latest)
                begin = np.searchsorted(inside, start - SNAP, side="left")
                end = np.searchsorted(inside, start + SLIDE_WINDOW + SNAP, side="right")
                found[rows, column] = (summed[end] - summed[begin]) / (end - begin)
        return found


def _trim_steps(stood: np.ndarray, heights: np.ndarray, touches: np.ndarray) -> None:
    """End contacts where a foot is lifted, and begin them where it is set down.

    Args:
        stood: Whether a link supports the robot, shape (n,); is changed.
        heights: Heights of its lowest point in [m], shape (n,).
        touches: Whether that touches the floor, shape (n,).
    """
    # Not their differences: heights far from the floor are infinite.
    end, rises = len(stood) - 1, heights[1:] > heights[:-1]
    falls = heights[1:] + SETTLED < heights[:-1]
    for first, last in runs(stood):
        while 0 < first < last and falls[first] and not touches[first]:
            stood[first] = False
            first += 1
        while first < last < end and rises[last - 1] and not touches[last]:
            stood[last] = False
            last -= 1


def _averaged(velocity: np.ndarray, place: np.ndarray) -> np.ndarray:
    """Return speed, velocity and place along x and y, shape (..., 5)."""
    along = velocity[..., :2]
    speed = np.hypot(along[..., :1], along[..., 1:])
    return np.concatenate([speed, along, place[..., :2]], axis=-1)


def _means(lowest: np.ndarray, touching: np.ndarray, owner: np.ndarray) -> np.ndarray:
    """Average over the points of a link that touch the floor.

    Which corner of a flat sole is the lowest is a matter of rounding.

    Args:
        lowest: Values of the lowest points, shape (n, n_links, m).
        touching: Values of all points that touch, shape (k, m).
        owner: Their samples and links, shape (2, k).

    Returns:
        Shape (n, n_links, m); the values of the lowest points where none touches.
    """
    shape = lowest.shape[:2]
    at = np.ravel_multi_index(tuple(owner), shape)
    count = np.bincount(at, minlength=shape[0] * shape[1])
    totals = [np.bincount(at, values, len(count)) for values in touching.T]
    means = np.stack(totals, axis=-1) / np.maximum(count, 1)[:, np.newaxis]
    means = means.reshape(lowest.shape)
    return np.where(count.reshape(shape)[..., np.newaxis] > 0, means, lowest)


def _steps(poses: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Compute how far points that are fixed to links move until the next sample.

    Args:
        poses: Poses of the links, shape (n, k, 7).
        points: In the map, shape (n, k, 3).

    Returns:
        Along x and y, shape (n, k, 2); NaN at the last sample.
    """
    turn = multiply(poses[1:, :, 3:], conjugate(poses[:-1, :, 3:]))
    moved = poses[1:, :, :3] + rotate(turn, points[:-1] - poses[:-1, :, :3])
    steps = np.full((*points.shape[:2], 2), np.nan)
    steps[:-1] = (moved - points[:-1])[..., :2]
    return steps


def _levels(
    sample: np.ndarray, points: np.ndarray, heights: np.ndarray, count: int
) -> np.ndarray:
    """Average the levels below low points, shape (n,); the floor's where is none."""
    totals = np.bincount(sample, points[:, 2] - heights, count)
    return np.asarray(totals / np.maximum(np.bincount(sample, minlength=count), 1))


def _spread(
    pieces: Sequence[GroundPiece], name: str, columns: np.ndarray, fill: float = 0.0
) -> np.ndarray:
    """Join an attribute of pieces, of the links of ``columns``.

    Returns:
        ``fill`` of links that are far from the floor, shape (n, n_links, ...).
    """
    values = [getattr(piece, name) for piece in pieces]
    count = sum(map(len, values))
    found = np.full((count, len(columns), *values[0].shape[2:]), fill)
    first = 0
    for piece, part in zip(pieces, values):
        found[first : first + len(part), np.searchsorted(columns, piece.columns)] = part
        first += len(part)
    return found
