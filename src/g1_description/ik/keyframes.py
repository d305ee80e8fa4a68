"""Motions through keyframes: smooth, within limits, feet that stand stay."""

from __future__ import annotations

from collections.abc import Collection, Generator, Iterator, Sequence

import numpy as np

from g1_description.errors import InvalidValueError
from g1_description.ik.inverse_kinematics import InverseKinematics
from g1_description.ik.keyframe_poses import (
    PASS,
    STOP,
    Keyframe,
    Keyframes,
    fixed_link_names,
)
from g1_description.ik.limits import TrajectoryBounds
from g1_description.ik.options import IkOptions
from g1_description.ik.solver import TOLERANCE
from g1_description.motion.edit import minimum_jerk_fraction
from g1_description.motion.motion import Motion
from g1_description.robot.assembly import root_in_base
from g1_description.robot.description import Description, limits_of
from g1_description.robot.kinematics import Kinematics
from g1_description.robot.rotation import angle_between
from g1_description.robot.transform import compose

PERIOD = 0.02
"""Time between samples in [s]; keyframes are at multiples of it."""

SPEED_SHARE = 0.99
"""Share of the limits of velocity and of the base's bounds that motions use."""

MOST_CHANGES = 10
"""How often times are lengthened for these."""

LEAST_GAIN = 0.95
"""Factor by which the excess must fall if times are to be lengthened again."""

MOST_SAMPLES = 100_000
"""Most samples of a motion."""


def keyframe_pieces(
    robot: Description,
    inverse: InverseKinematics,
    fixed_links: Collection[str] | None,
    keyframes: Sequence[Keyframe],
    through: str = STOP,
) -> Iterator[Keyframes | None]:
    """Move through keyframes; a link that is at one place in two of them stays there.

    Args:
        robot: The robot.
        inverse: Its inverse kinematics.
        fixed_links: Names or roles of the links that stay; None: the profile's feet.
        keyframes: In the order of their times, at least two.
        through: ``STOP`` or ``PASS``.

    Yields:
        None after each sample that takes time; at last the keyframes with their motion.

    Raises:
        UnknownNameError: If a link is unknown.
        InvalidValueError: If there are fewer than two, times do not increase, the
            motion is too long, or ``through`` is something else.
    """
    if len(keyframes) < 2:
        raise InvalidValueError(
            f"A motion needs at least two keyframes (got {len(keyframes)})."
        )
    times = np.array([frame.time for frame in keyframes])
    if not (np.isfinite(times).all() and (np.diff(times) > 0.0).all()):
        raise InvalidValueError(
            f"The times of keyframes must increase (got {times.tolist()})."
        )
    if through not in (STOP, PASS):
        raise InvalidValueError(f"through must be {STOP} or {PASS} (got {through!r}).")
    between = _Between(robot, inverse, fixed_links, keyframes, through)
    counts = np.maximum(1.0, np.diff(np.round((times - times[0]) / PERIOD)))
    before = np.inf
    slow: dict[int, str] = {}
    motion = yield from between.motion(counts)
    for change in range(MOST_CHANGES + 1):
        excess, reasons = between.excess(motion, counts)
        no_gain = excess.max() - 1.0 > LEAST_GAIN * before
        if change == MOST_CHANGES or no_gain or not (excess > 1.0).any():
            break
        before = excess.max() - 1.0
        for row in np.flatnonzero(excess > 1.0).tolist():
            slow.setdefault(row, reasons[row])
            counts[row] = max(np.ceil(counts[row] * excess[row]), counts[row] + 1.0)
        motion = yield from between.motion(counts)
    ends = times[0] + PERIOD * np.concatenate([[0.0], np.cumsum(counts)])
    message = ""
    if slow:
        row = min(slow)
        message = (
            f"Keyframe {row + 2} is later than set, at {ends[row + 1]:.2f} s instead "
            f"of {times[row + 1]:.2f} s: {slow[row]} would be too fast."
        )
    for row in np.flatnonzero(SPEED_SHARE * excess > 1.0)[:1].tolist():
        message += f" Even so, {reasons[row]} is too fast before keyframe {row + 2}."
    message = f"{message} {between.missed}".strip()
    frames = map(Keyframe, ends.tolist(), between.positions, between.bases)
    links = None if fixed_links is None else tuple(fixed_links)
    yield Keyframes(robot, tuple(frames), links, through, motion, message)


class _Between:
    """Interpolates between keyframes of a robot."""

    def __init__(
        self,
        robot: Description,
        inverse: InverseKinematics,
        fixed_links: Collection[str] | None,
        keyframes: Sequence[Keyframe],
        through: str,
    ) -> None:
        self._inverse, self._through = inverse, through
        self._begin = keyframes[0].time
        self.missed = ""
        """A sentence on the first link of the last motion that does not stay."""
        joints = robot.movable_joints
        self._names = tuple(joint.name for joint in joints)
        speed = np.array([joint.velocity for joint in joints])
        self._speed = SPEED_SHARE * np.where(speed > 0.0, speed, np.inf)
        self.bases = _continuous(np.array([frame.base for frame in keyframes]))
        positions = np.array([frame.positions for frame in keyframes])
        self.positions = np.clip(positions, *limits_of(joints))
        links = [name for name in robot.link_names if name in inverse.links]
        roots = compose(self.bases, root_in_base(robot))
        poses = Kinematics(robot).link_poses(roots, self.positions)
        self._fixed = {
            link: poses[:, links.index(link)]
            for link in fixed_link_names(robot, fixed_links)
        }

    def motion(self, counts: np.ndarray) -> Generator[None, None, Motion]:
        """Interpolate with numbers of samples per segment; yield after slow ones."""
        if not counts.sum() < MOST_SAMPLES:
            raise InvalidValueError(
                f"The motion would last {PERIOD * counts.sum():.4g} s, at most "
                f"{PERIOD * MOST_SAMPLES:g} s are possible. Times are in s, places of "
                "the base in m."
            )
        ends = np.concatenate([[0.0], np.cumsum(counts)]).astype(int)
        values = np.concatenate([self.positions, self.bases], axis=1)
        stays = [self._staying(segment) for segment in range(len(counts))]
        changes = [one.keys() != other.keys() for one, other in zip(stays, stays[1:])]
        rests = np.array([True, *changes, True])  # a foot begins or ends to stay
        values = _interpolated(values, ends, rests, self._through)
        self.missed = ""
        for begin, end, staying in zip(ends, ends[1:], stays):
            for row in range(begin + 1, end) if staying else ():
                share = (row - begin) / (end - begin)
                missed = self._settle(values[row], staying, share)
                if missed and not self.missed:
                    self.missed = f"At {self._begin + PERIOD * row:.2f} s: {missed}"
                yield
        n_joints = len(self._names)
        return Motion(
            self._begin + PERIOD * np.arange(len(values)),
            self._names,
            values[:, :n_joints],
            base_poses=values[:, n_joints:],
        )

    def excess(
        self, motion: Motion, counts: np.ndarray
    ) -> tuple[np.ndarray, list[str]]:
        """Compare each segment with the limits of velocity and the base's bounds.

        Returns:
            The largest share of a limit that is used, shape (n_segments,), and what
            uses it. An acceleration counts by its square root, as it falls with the
            square of the duration.
        """
        base, bounds = motion.base_poses, TrajectoryBounds()
        assert base is not None
        steps = np.diff(base[:, :3], axis=0) / PERIOD
        rests = np.zeros((1, 3))
        changes = np.diff(np.concatenate([rests, steps, rests]), axis=0) / PERIOD
        quick = np.sqrt(np.linalg.norm(changes, axis=1) / bounds.base_acceleration)
        turns = angle_between(base[:-1, 3:], base[1:, 3:]) / PERIOD
        fastest = [
            np.linalg.norm(steps, axis=1) / bounds.base_speed,
            turns / bounds.base_turn_rate,
            np.maximum(quick[:-1], quick[1:]),
        ]
        joints = np.abs(np.diff(motion.positions, axis=0)) / PERIOD / self._speed
        used = np.column_stack([joints, np.max(fastest, axis=0) / SPEED_SHARE])
        begins = np.concatenate([[0.0], np.cumsum(counts)[:-1]]).astype(int)
        found = np.maximum.reduceat(used, begins)
        names = [*self._names, "the base"]
        return found.max(axis=1), [names[column] for column in found.argmax(axis=1)]

    def _staying(self, segment: int) -> dict[str, np.ndarray]:
        """Find the links that stay in a segment: their poses at both ends."""
        found = {}
        for link, poses in self._fixed.items():
            first, last = poses[segment], poses[segment + 1]
            moved = np.linalg.norm(last[:3] - first[:3])
            turned = angle_between(first[3:], last[3:])
            if moved < TOLERANCE[0] and turned < TOLERANCE[1]:
                found[link] = _continuous(np.stack([first, last]))
        return found

    def _settle(
        self, value: np.ndarray, staying: dict[str, np.ndarray], share: float
    ) -> str:
        """Keep links where they stay; return a sentence on those that cannot."""
        targets = {
            link: _normalized((1.0 - share) * ends[0] + share * ends[1])
            for link, ends in staying.items()
        }
        n_joints = len(self._names)
        options = IkOptions(
            fixed_links=(), base_motion="free", weights=dict.fromkeys(targets, np.inf)
        )
        positions, base = value[:n_joints], value[n_joints:]
        found = self._inverse.solve(targets, positions, base, options, 1)
        value[:n_joints], value[n_joints:] = found.positions, found.base
        return found.message


def _interpolated(
    values: np.ndarray, ends: np.ndarray, rests: np.ndarray, through: str
) -> np.ndarray:
    """Interpolate rows of joints and base at samples from 0 to the last end.

    Without stops it still comes to rest at some rows, shape (n_keyframes,) of bools.
    """
    from scipy.interpolate import CubicHermiteSpline, PchipInterpolator  # slow

    samples = np.arange(ends[-1] + 1)
    if through == STOP:
        row = np.clip(np.searchsorted(ends, samples, "right") - 1, 0, len(ends) - 2)
        u = ((samples - ends[row]) / (ends[row + 1] - ends[row]))[:, np.newaxis]
        done = minimum_jerk_fraction(u)
        found = values[row] + done * (values[row + 1] - values[row])
    else:
        slopes = PchipInterpolator(ends, values).derivative()(ends)
        slopes[rests] = 0.0
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
