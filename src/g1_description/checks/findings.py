"""All that may be wrong with a motion, from what was measured of it."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

import numpy as np

from g1_description.checks import limits
from g1_description.checks.balance import balance_faults
from g1_description.checks.frames import Frames, Parts
from g1_description.checks.ground import sliding_speeds
from g1_description.checks.ground_findings import float_heights, ground_faults
from g1_description.checks.limits import NearJumps
from g1_description.checks.states import States
from g1_description.checks.timeline import Timeline
from g1_description.checks.verdict import Fault
from g1_description.collisions.distances import Contacts


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


def deepest(contacts: Contacts | None, n_samples: int) -> np.ndarray:
    """Return the depth of the deepest contact of each sample in [m].

    Zero where there is none; NaN where contacts were not looked for.
    """
    if contacts is None:
        return np.full(n_samples, np.nan)
    depth = np.zeros(n_samples)
    np.maximum.at(depth, contacts.frame, -contacts.distance)
    return depth


def all_faults(
    parts: Parts, states: States, frames: Frames, timeline: Timeline
) -> Iterator[Fault]:
    """Find everything that may be wrong; thresholds decide what is.

    One after the other: all faults of a long motion need more memory than it does.

    Args:
        parts: The robot.
        states: The motion.
        frames: What was measured.
        timeline: The same, for people.
    """
    joints = states.joints_of(parts.joints)
    jumps = limits.jump_faults(states, joints, parts.thresholds)
    near = limits.near_jumps(jumps, states.times, parts.thresholds)
    is_known = ~near.window & ~_at_ends(states.times, parts.thresholds.window)
    yield from jumps
    yield from _joint_faults(parts, states, timeline, near)
    yield from _effort_faults(parts, frames.efforts, is_known)
    yield from _collision_faults(parts, frames, len(states.times))
    yield from _ground_faults(parts, states, frames, near.body)
    if frames.balance is not None:
        floor = parts.thresholds.floor_height
        yield from balance_faults(frames.balance, is_known, floor)


def _at_ends(times: np.ndarray, window: float) -> np.ndarray:
    """Mark the samples whose window reaches beyond the motion, which tells nothing."""
    is_early, is_late = times < times[0] + window, times > times[-1] - window
    return (is_early | is_late) & (len(times) > 1)


def _joint_faults(
    parts: Parts, states: States, timeline: Timeline, near: NearJumps
) -> Iterator[Fault]:
    """Find what is wrong with single joints, besides jumps."""
    joints, thresholds = states.joints_of(parts.joints), parts.thresholds
    least = thresholds.position.least
    yield from limits.position_faults(joints, timeline.positions, least)
    names = timeline.joint_names
    bounds = {
        "velocity": np.array([joint.velocity for joint in joints]),
        "acceleration": thresholds.acceleration_bounds.of(names),
        "jerk": thresholds.jerk_bounds.of(names),
    }
    for check, bound in bounds.items():
        if np.isfinite(bound).any():
            known = _rates(check, states, timeline)
            for name, rows in near.joints.items():
                known[rows, names.index(name)] = np.nan
            least = getattr(thresholds, check).least
            yield from limits.rate_faults(check, joints, known, bound, least)


def _rates(check: str, states: States, timeline: Timeline) -> np.ndarray:
    """Return what a check compares with bounds, shape (n, n_joints)."""
    if check == "velocity":
        return timeline.velocities.copy()
    acceleration, jerk = limits.derivatives(states.trajectory)
    return states.spread(acceleration if check == "acceleration" else jerk, np.nan)


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


def _collision_faults(parts: Parts, frames: Frames, n_samples: int) -> Iterable[Fault]:
    """Find links that touch each other."""
    if frames.contacts is None:
        return ()
    return collision_faults(frames.contacts, parts.collisions.pairs, n_samples)


def _ground_faults(
    parts: Parts, states: States, frames: Frames, near_jump: np.ndarray
) -> list[Fault]:
    """Find what is wrong with the robot on its floor."""
    ground, times, thresholds = frames.ground, states.times, parts.thresholds
    if ground is None:
        return []
    if frames.balance is None:
        center = states.base_poses()[:, :3]
    else:
        center = frames.balance.center
    heights = ground.heights.min(axis=1)
    floats = float_heights(heights, center[:, 2], times, thresholds.bearing_height)
    touches = parts.ground.touching(ground, times) & ~near_jump[:, np.newaxis]
    slides = sliding_speeds(ground.slide, touches, times)
    names = [parts.ground_links[column] for column in ground.columns]
    return ground_faults(names, ground, slides, floats)
