"""Motions through keyframes: smooth, within limits, feet that stand stay."""

from __future__ import annotations

from collections.abc import Generator, Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from g1_description.errors import InvalidValueError
from g1_description.ik.inverse_kinematics import IkOptions, InverseKinematics
from g1_description.ik.solver import TOLERANCE
from g1_description.motion.motion import Motion
from g1_description.robot.assembly import root_in_base
from g1_description.robot.description import Description
from g1_description.robot.kinematics import Kinematics
from g1_description.robot.rotation import angle_between
from g1_description.robot.transform import compose

PERIOD = 0.02
"""Time between samples in [s]; keyframes are at multiples of it."""

STOP, PASS = "stop at each", "pass through"
"""Ways through keyframes: from rest to rest with minimum jerk, or a cubic spline."""

SPEED_SHARE = 0.99
"""Share of the velocity limits that motions use."""

MOST_CHANGES = 10
"""How often times are lengthened for velocity limits."""

LEAST_GAIN = 0.95
"""Factor by which velocities must fall if times are to be lengthened again."""


class Keyframe(NamedTuple):
    """A configuration at a time."""

    time: float
    """In [s]."""

    positions: np.ndarray
    """Positions in [rad] or [m], clipped to the limits, shape (n_joints,)."""

    base: np.ndarray
    """Pose of the base link in the map, shape (7,)."""


@dataclass(frozen=True, eq=False)
class KeyframeMotion:
    """A motion through keyframes."""

    motion: Motion
    """With the base, 50 samples per second."""

    times: tuple[float, ...]
    """Times of the keyframes in [s], from 0; later than given where velocity limits
    need it."""


def keyframe_pieces(
    robot: Description,
    inverse: InverseKinematics,
    feet: Sequence[str],
    keyframes: Sequence[Keyframe],
    way: str = STOP,
) -> Iterator[KeyframeMotion | None]:
    """Move through keyframes; a foot that is at one place in two of them stays there.

    Args:
        robot: The robot.
        inverse: Its inverse kinematics.
        feet: Names of its feet.
        keyframes: In the order of their times, at least two.
        way: ``STOP`` or ``PASS``.

    Yields:
        None after each sample that takes time; at last the motion.

    Raises:
        InvalidValueError: If there are fewer than two, or times do not increase.
    """
    if len(keyframes) < 2:
        raise InvalidValueError(
            f"A motion needs at least two keyframes (got {len(keyframes)})."
        )
    durations = np.diff([frame.time for frame in keyframes])
    if not (durations > 0.0).all():
        raise InvalidValueError("The times of keyframes must increase.")
    between = _Between(robot, inverse, feet, keyframes, way)
    counts = np.maximum(1, np.round(durations / PERIOD)).astype(int)
    motion, before = (yield from between.motion(counts)), np.inf
    for _ in range(MOST_CHANGES):
        excess = between.excess(motion, counts)
        if not (excess > 1.0).any() or excess.max() > LEAST_GAIN * before:
            break
        before = excess.max()
        more = np.ceil(counts * np.maximum(excess, 1.0)).astype(int)
        counts = np.where(excess > 1.0, np.maximum(more, counts + 1), counts)
        motion = yield from between.motion(counts)
    times = PERIOD * np.concatenate([[0], np.cumsum(counts)])
    yield KeyframeMotion(motion, tuple(times.tolist()))


class _Between:
    """Interpolates between keyframes of a robot."""

    def __init__(
        self,
        robot: Description,
        inverse: InverseKinematics,
        feet: Sequence[str],
        keyframes: Sequence[Keyframe],
        way: str,
    ) -> None:
        self._inverse, self._way = inverse, way
        joints = robot.movable_joints
        self._names = tuple(joint.name for joint in joints)
        self._lower = np.array([joint.lower for joint in joints])
        self._upper = np.array([joint.upper for joint in joints])
        speed = np.array([joint.velocity for joint in joints])
        self._speed = SPEED_SHARE * np.where(speed > 0.0, speed, np.inf)
        bases = _continuous(np.array([frame.base for frame in keyframes]))
        given = np.array([frame.positions for frame in keyframes])
        positions = np.clip(given, self._lower, self._upper)
        self._values = np.concatenate([positions, bases], axis=1)
        roots = compose(bases, root_in_base(robot))
        links = [name for name in robot.link_names if name in inverse.links]
        poses = Kinematics(robot).link_poses(roots, positions)
        self._feet = {foot: poses[:, links.index(foot)] for foot in feet}

    def motion(self, counts: np.ndarray) -> Generator[None, None, Motion]:
        """Interpolate with numbers of samples per segment; yield after slow ones."""
        ends = np.concatenate([[0], np.cumsum(counts)])
        values = _interpolated(self._values, ends, self._way)
        for segment, (begin, end) in enumerate(zip(ends, ends[1:])):
            standing = self._standing(segment)
            for row in range(begin + 1, end) if standing else ():
                share = (row - begin) / (end - begin)
                self._settle(values[row], standing, share)
                yield
        n_joints = len(self._names)
        return Motion(
            PERIOD * np.arange(len(values)),
            self._names,
            values[:, :n_joints],
            base_poses=values[:, n_joints:],
        )

    def excess(self, motion: Motion, counts: np.ndarray) -> np.ndarray:
        """Compare the velocities of each segment with the limits; 1: at a limit."""
        steps = np.abs(np.diff(motion.positions, axis=0)) / PERIOD
        relative = (steps / self._speed).max(axis=1)
        begins = np.concatenate([[0], np.cumsum(counts)[:-1]])
        return np.maximum.reduceat(relative, begins)

    def _standing(self, segment: int) -> dict[str, np.ndarray]:
        """Find the feet that stay in a segment: their poses at both ends."""
        found = {}
        for foot, poses in self._feet.items():
            first, last = poses[segment], poses[segment + 1]
            moved = np.linalg.norm(last[:3] - first[:3])
            turned = angle_between(first[3:], last[3:])
            if moved < TOLERANCE[0] and turned < TOLERANCE[1]:
                found[foot] = _continuous(np.stack([first, last]))
        return found

    def _settle(
        self, value: np.ndarray, standing: dict[str, np.ndarray], share: float
    ) -> None:
        """Keep feet where they stand."""
        targets = {
            foot: _normalized((1.0 - share) * ends[0] + share * ends[1])
            for foot, ends in standing.items()
        }
        n_joints = len(self._names)
        options = IkOptions(
            fixed_links=(), base_motion="free", weights=dict.fromkeys(targets, np.inf)
        )
        positions, base = value[:n_joints], value[n_joints:]
        found = self._inverse.solve(targets, positions, base, options, 1)
        value[:n_joints], value[n_joints:] = found.positions, found.base


def _interpolated(values: np.ndarray, ends: np.ndarray, way: str) -> np.ndarray:
    """Interpolate rows of joints and base at samples from 0 to the last end.

    Source of the polynomial: Flash and Hogan, J. Neurosci. 5, 1985.
    """
    from scipy.interpolate import CubicHermiteSpline, PchipInterpolator  # slow

    samples = np.arange(ends[-1] + 1)
    if way == STOP:
        row = np.clip(np.searchsorted(ends, samples, "right") - 1, 0, len(ends) - 2)
        u = ((samples - ends[row]) / (ends[row + 1] - ends[row]))[:, np.newaxis]
        way_done = u**3 * (10.0 - 15.0 * u + 6.0 * u**2)
        found = values[row] + way_done * (values[row + 1] - values[row])
    else:
        slopes = PchipInterpolator(ends, values).derivative()(ends)
        slopes[[0, -1]] = 0.0
        found = CubicHermiteSpline(ends, values, slopes)(samples)
    return _normalized(found)


def _normalized(rows: np.ndarray) -> np.ndarray:
    """Normalize the quaternions, which come last."""
    rows = rows.copy()
    rows[..., -4:] /= np.linalg.norm(rows[..., -4:], axis=-1, keepdims=True)
    return rows


def _continuous(poses: np.ndarray) -> np.ndarray:
    """Choose the signs of quaternions so that each is near the one before."""
    poses = poses.copy()
    for before, pose in zip(poses, poses[1:]):
        if before[3:] @ pose[3:] < 0.0:
            pose[3:] *= -1.0
    return poses
