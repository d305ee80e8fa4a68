"""All that may be wrong with a motion, from what was measured of it."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

import numpy as np

from g1_description.checks import limits
from g1_description.checks.balance import balance_faults
from g1_description.checks.finding import Fault, runs
from g1_description.checks.ground import GroundFrames, sliding_speeds
from g1_description.checks.limits import NearJumps
from g1_description.checks.measured import Measured, Parts
from g1_description.collisions.distances import Contacts
from g1_description.robot.dynamics import GRAVITY

FREE_FALL = 0.5
"""Share of gravity from which on a robot in the air falls, instead of floating."""

SHORTEST_FLIGHT = 0.1
"""A robot in the air for a shorter time is not checked, in [s]: its acceleration cannot
be told from noise."""


def collision_faults(
    contacts: Contacts, pairs: Sequence[tuple[str, str]], n_samples: int
) -> Iterator[Fault]:
    """Sort contacts by the pair of links that touch.

    Args:
        contacts: Of all samples.
        pairs: Names of the links of each pair.
        n_samples: How many samples the motion has.

    Returns:
        A fault per pair that touches; its points are those of both links.
    """
    for pair in np.unique(contacts.pair):
        rows = np.flatnonzero(contacts.pair == pair)
        sizes = np.full(n_samples, -np.inf)
        np.maximum.at(sizes, contacts.frame[rows], -contacts.distance[rows])
        points = np.full((n_samples, 2, 3), np.nan)
        is_deepest = -contacts.distance[rows] == sizes[contacts.frame[rows]]
        deep = rows[is_deepest]
        points[contacts.frame[deep], 0] = contacts.points_a[deep]
        points[contacts.frame[deep], 1] = contacts.points_b[deep]
        first, second = pairs[pair]
        text = f"{first} is {{worst:.4g}} m deep in {second} at {{time:.3f}} s"
        yield Fault("self_collision", pairs[pair], sizes, "m", text, points)


def all_faults(parts: Parts, measured: Measured) -> Iterator[Fault]:
    """Find everything that may be wrong; thresholds decide what is.

    One after the other: all faults of a long motion need more memory than it does.

    Args:
        parts: The robot.
        measured: The motion.
    """
    joints = measured.joints_of(parts.joints)
    jumps = limits.jump_faults(measured, joints, parts.thresholds)
    near = limits.near_jumps(jumps, measured.times, parts.thresholds)
    is_known = ~near.window & ~_at_ends(measured.times, parts.thresholds.window)
    yield from jumps
    yield from _joint_faults(parts, measured, near)
    yield from _effort_faults(parts, measured.efforts, is_known)
    yield from _collision_faults(parts, measured)
    yield from _ground_faults(parts, measured, near.body)
    if measured.balance is not None:
        floor = parts.thresholds.floor_height
        yield from balance_faults(measured.balance, is_known, floor)


def _at_ends(times: np.ndarray, window: float) -> np.ndarray:
    """Mark the samples whose window reaches beyond the motion, which tells nothing."""
    is_early, is_late = times < times[0] + window, times > times[-1] - window
    return (is_early | is_late) & (len(times) > 1)


def _joint_faults(parts: Parts, measured: Measured, near: NearJumps) -> Iterator[Fault]:
    """Find what is wrong with single joints, besides jumps."""
    joints, thresholds = measured.joints_of(parts.joints), parts.thresholds
    least = thresholds.position.least
    yield from limits.position_faults(joints, measured.positions, least)
    names = measured.joint_names
    bounds = {
        "velocity": np.array([joint.velocity for joint in joints]),
        "acceleration": thresholds.acceleration_bounds.of(names),
        "jerk": thresholds.jerk_bounds.of(names),
    }
    for check, bound in bounds.items():
        if np.isfinite(bound).any():
            known = _rates(check, measured)
            for name, rows in near.joints.items():
                known[rows, names.index(name)] = np.nan
            least = getattr(thresholds, check).least
            yield from limits.rate_faults(check, joints, known, bound, least)


def _rates(check: str, measured: Measured) -> np.ndarray:
    """Return what a check compares with bounds, shape (n, n_joints)."""
    if check == "velocity":
        return measured.velocities.copy()
    acceleration, jerk = limits.derivatives(measured.trajectory)
    return measured.spread(acceleration if check == "acceleration" else jerk, np.nan)


def _effort_faults(
    parts: Parts, efforts: np.ndarray | None, is_known: np.ndarray
) -> Iterable[Fault]:
    """Find efforts beyond their limits."""
    if efforts is None:
        return ()
    most = np.array([joint.effort for joint in parts.joints])
    known = np.where(is_known[:, np.newaxis], efforts, np.nan)
    least = parts.thresholds.effort.least
    return limits.rate_faults("effort", parts.joints, known, most, least)


def _collision_faults(parts: Parts, measured: Measured) -> Iterable[Fault]:
    """Find links that touch each other."""
    if measured.contacts is None:
        return ()
    pairs = parts.collisions.pairs
    return collision_faults(measured.contacts, pairs, len(measured.times))


def _ground_faults(
    parts: Parts, measured: Measured, near_jump: np.ndarray
) -> list[Fault]:
    """Find what is wrong with the robot on its floor."""
    ground, times, thresholds = measured.ground, measured.times, parts.thresholds
    if ground is None:
        return []
    if measured.balance is None:
        center = measured.base_poses()[:, :3]
    else:
        center = measured.balance.center
    heights = ground.heights.min(axis=1)
    floats = float_heights(heights, center[:, 2], times, thresholds.bearing_height)
    touches = parts.ground.touching(ground, times) & ~near_jump[:, np.newaxis]
    slides = sliding_speeds(ground.slide, touches, times)
    return ground_faults(measured.ground_links, ground, slides, floats)


def ground_faults(
    names: Sequence[str],
    frames: GroundFrames,
    slides: np.ndarray,
    airborne: np.ndarray,
) -> list[Fault]:
    """Find what is wrong with a robot on its floor.

    Args:
        names: Of the links with outlines.
        frames: How it stands at each sample.
        slides: How fast links slide that touch the floor, shape (n, n_links).
        airborne: What ``float_heights`` returned, shape (n,).

    Returns:
        Depths of links in the floor, heights and speeds of those that bear, and the
        height of a robot that floats.
    """
    faults = []
    is_low = frames.bears | ~np.isnan(slides)
    for column in np.flatnonzero(is_low.any(axis=0)):
        link, heights = (names[column],), frames.heights[:, column]
        points = frames.lowest[:, column]
        text = f"{link[0]} is {{worst:.4g}} m deep in the floor at {{time:.3f}} s"
        faults.append(Fault("penetration", link, -heights, "m", text, points))
        text = f"{link[0]} slides on the floor with {{worst:.4g}} m/s at {{time:.3f}} s"
        faults.append(Fault("skating", link, slides[:, column], "m/s", text, points))
        high = np.where(frames.bears[:, column], heights, np.nan)
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
    for first, last in runs(in_air):
        rows = slice(first, last + 1)
        if times[last] - times[first] >= SHORTEST_FLIGHT and last - first > 1:
            elapsed = times[rows] - times[first]
            curve = np.polyfit(elapsed, center_heights[rows], 2)[0]
            if 2.0 * curve > -FREE_FALL * GRAVITY:
                floats[rows] = heights[rows]
    return floats
