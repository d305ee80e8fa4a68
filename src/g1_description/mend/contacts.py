"""Stances of feet and hands: when they stand, and at which points."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from g1_description.checks.intervals import runs
from g1_description.checks.measured import CheckedRobot, Measured
from g1_description.robot.rotation import to_axes

FLAT = 0.01
"""Points of a link up to this height above its lowest one stand, too, in [m]."""

DRAG, SLOW = 0.3, 0.1
"""A foot that is dragged along the floor reaches the first speed, and is faster than
the second one; one that rests is slower than that, upwards, too, in [m/s]."""

BARELY, LOW = 0.01, 0.05
"""Heights above where the link stands up to which points move along the floor as
before, also where nothing is corrected, in [m]: another speed would be a slip."""

MOMENT, NEAR = 0.5, 0.04
"""A robot that has no contact for less than this time in [s], and a link as near to the
floor, in [m], stands on it."""

BRIEF = 0.065
"""Moments in which a foot does not stand, or is lifted, are ignored if the samples
before and after are at most this far apart, in [s]."""

MOST_POINTS = 12
"""Most points of a link that are looked at: those that are the lowest most often."""


@dataclass(frozen=True, eq=False)
class Stance:
    """A link that is in contact at times; n samples, k points of the link."""

    link: int
    """Row of the link."""

    points: np.ndarray
    """In the link's frame in [m], shape (k, 3)."""

    radii: np.ndarray
    """The floor is touched this far below the points, in [m], shape (k,)."""

    stands: np.ndarray
    """Whether a point is in contact, shape (n, k)."""

    drags: np.ndarray
    """Whether the link moves over the floor while another one stands, shape (n,)."""

    moves: np.ndarray
    """Whether a point is near the floor and moves along it as before, shape (n, k)."""

    level: np.ndarray
    """Height of the lowest point above the floor where the link stood last, and will
    stand next, in [m], shape (n,)."""

    offsets: np.ndarray
    """Heights of points above the lowest one of the link, which stay, in [m], shape
    (n, k)."""


def placed_points(poses: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Place points of a link in the map.

    Args:
        poses: Of the link, shape (n, 7).
        points: In its frame, shape (k, 3).

    Returns:
        Shape (n, k, 3).
    """
    turned = points @ np.swapaxes(to_axes(poses[:, 3:]), 1, 2)
    return np.asarray(turned + poses[:, np.newaxis, :3])


def stances(measured: Measured) -> list[Stance]:
    """Find the links in contact, at the samples of a motion."""
    robot, ground, motion = measured.robot, measured.ground, measured.motion
    assert ground is not None
    floor = robot.thresholds.floor_height
    at = np.searchsorted(measured.times, motion.times)
    base, positions = measured.at(motion.times)[:2]
    poses = robot.kinematics.link_poses(base, positions)
    in_contact = (ground.in_contact | robot.ground.lonely(ground, measured.times))[at]
    steps = np.linalg.norm(ground.steps[at], axis=-1)
    gaps = np.diff(measured.times, append=np.inf)[at]  # nothing moves after the last
    speeds = np.nan_to_num(steps) / gaps[:, np.newaxis]
    supports = in_contact & ~_dragged(in_contact, speeds)
    carriers = _carriers(supports, ground.heights[at], speeds, motion.times)
    carriers &= in_contact.sum(axis=1, keepdims=True) < 2
    in_contact |= carriers
    drags = _dragged(in_contact, speeds)
    slides = (in_contact.sum(axis=1) > 1) & (drags | ~in_contact).all(axis=1)
    drags[slides] = False  # the whole robot slides, which locks undo
    found = []
    for column in np.flatnonzero(in_contact.any(axis=0)):
        link = int(robot.ground.rows[ground.columns[column]])
        touches = in_contact[:, column]
        points, radii = _points(robot, link, poses[touches, link])
        heights = placed_points(poses[:, link], points)[..., 2] - radii - floor
        offsets = heights - heights.min(axis=1, keepdims=True)
        lowest, times = heights.min(axis=1), motion.times
        rests = np.ones(len(times), dtype=bool)
        if len(times) > 1:  # a foot that arrives or leaves is still in the air
            rests = np.abs(np.gradient(lowest, times)) < SLOW
        still = touches & ~drags[:, column] & (rests | carriers[:, column])
        level = np.zeros(len(times))
        if still.any():
            level = np.interp(times, times[still], lowest[still])
            slow = rests & (speeds[:, column] < SLOW)
            still |= slow & (np.abs(lowest - level) < BARELY / 2)
            level = np.interp(times, times[still], lowest[still])
        still = ~_lasting(~still, times)
        stands = still[:, np.newaxis] & (offsets < FLAT)
        fast = speeds[:, column] > SLOW
        lifts = _lasting(~still & (drags[:, column] | fast), times)
        moves = (heights - level[:, np.newaxis] < BARELY) & ~stands
        given = link, points, radii, stands, lifts, moves, level, offsets
        found.append(Stance(*given))
    return found


def _lasting(mask: np.ndarray, times: np.ndarray) -> np.ndarray:
    """Drop what is over in a moment: lowest points jump from one corner to another."""
    found = mask.copy()
    for first, last in runs(mask):
        if first > 0 and last < len(times) - 1:
            found[first : last + 1] = times[last + 1] - times[first - 1] > BRIEF
    return found


def _carriers(
    supports: np.ndarray, heights: np.ndarray, speeds: np.ndarray, times: np.ndarray
) -> np.ndarray:
    """Find the links near the floor that stand while no other one does.

    They stand by themselves at other times.

    Args:
        supports: Whether a link is in contact, and not dragged, shape (n, n_links).
        heights: Heights of the links' lowest points in [m], shape (n, n_links).
        speeds: In [m/s], shape (n, n_links).
        times: In [s], shape (n,).
    """
    near = (heights < NEAR) & supports.any(axis=0)
    alone = ~supports.any(axis=1, keepdims=True)
    found = alone & near & (speeds < SLOW)
    for first, last in runs(~(supports | found).any(axis=1)):
        rows = slice(first, last + 1)
        if times[last] - times[first] < MOMENT and near[rows].any(axis=1).all():
            slowest = np.where(near[rows], speeds[rows], np.inf).argmin(axis=1)
            at = np.arange(first, last + 1)
            found[at, slowest] = speeds[at, slowest] < 2.0 * SLOW
    return found


def _dragged(touches: np.ndarray, speeds: np.ndarray) -> np.ndarray:
    """Mark the samples of contacts in which links are dragged, shape (n, n_links)."""
    found = np.zeros(touches.shape, dtype=bool)
    for column, fast in enumerate((touches & (speeds > SLOW)).T):
        for first, last in runs(fast):
            rows = slice(first, last + 1)
            found[rows, column] = speeds[rows, column].max() > DRAG
    return found


def _points(
    robot: CheckedRobot, link: int, poses: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Choose the points of a link that are the lowest, and their radii."""
    shapes = [shape for shape in robot.collisions.shapes if shape.link == link]
    points = np.concatenate([shape.points for shape in shapes])
    radii = np.concatenate([np.full(len(s.points), s.radius) for s in shapes])
    heights = placed_points(poses, points)[..., 2] - radii
    low = (heights - heights.min(axis=1, keepdims=True) < FLAT).sum(axis=0)
    order = np.sort(np.argsort(-low, kind="stable")[:MOST_POINTS])
    return points[order], radii[order]
