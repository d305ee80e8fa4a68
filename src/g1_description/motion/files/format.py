"""The record of a format of motion files: how it is recognised, read and written.

Functions that writers share follow: even times, all joints, bodies, npz.
"""

from __future__ import annotations

import io
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Callable, Mapping, Union

import numpy as np

from g1_description.errors import InvalidValueError, MotionError
from g1_description.motion.files.conventions import ASAP_JOINTS, G1_JOINTS, of_robot
from g1_description.motion.files.source import MotionSource
from g1_description.motion.motion import Motion, sample
from g1_description.motion.paths import with_rate
from g1_description.robot.description import Description
from g1_description.robot.kinematics import Kinematics
from g1_description.text import listed

Content = Union[bytes, Mapping[str, bytes]]
"""Content of a file, or of a folder's files by name."""

OPEN = "open"
"""Order of quaternions on which publishers of a format disagree."""


@dataclass(frozen=True)
class Writer:
    """How a format is written."""

    ending: str
    """Extension of its files; empty: it is a folder."""

    write: Callable[[Motion, Description, float | None], tuple[Content, Sequence[str]]]
    """Given a motion, its robot and a rate in [Hz] (None: that of the motion), returns
    the file's bytes, or those of a folder's files by name, and messages on differences
    from the motion."""

    assumed: float | None = None
    """Rate in [Hz] that readers assume; None: it is in the file."""

    fixed: float | None = None
    """Rate in [Hz] of all files; None: that of the motion."""

    merged: Callable[[Mapping[str, bytes]], bytes] | None = None
    """Makes a file of several motions of their files by name; None: it has only one."""

    most_samples: Callable[[Sequence[str], bool, int], int] | None = None
    """Given the names of joints, whether there is a base, and a size in bytes, returns
    the largest number of samples of a file; None: the format is not recorded."""

    def rate(self, motion: Motion, rate: float | None) -> float:
        """Return the rate of the samples that are written, in [Hz]."""
        return self.fixed or mean_rate(motion, rate)

    def place(self, path: Path, motion: Motion) -> Path:
        """Return a path whose name has no other rate than its motion."""
        is_open = self.assumed is not None
        return with_rate(path, self.rate(motion, None)) if is_open else path


@dataclass(frozen=True)
class Format:
    """A format of motion files."""

    name: str

    recognise: Callable[[MotionSource], bool]
    """Returns whether a file has this format, by its content."""

    read: Callable[[MotionSource, Description], Motion]
    """Reads a motion, with ``has_times=False`` if the file does not say its rate."""

    endings: tuple[str, ...] = ()
    """Extensions of its files in folders; files that are given may have any name."""

    order: str | None = None
    """Order of base quaternions: xyzw, wxyz or ``OPEN``; None: there are none."""

    assumed_rate: float | None = None
    """Rate of files without one, in [Hz]; None: it has to be given."""

    rate_of: str = ""
    """Which rate that is, for the message."""

    names: Callable[[MotionSource], Sequence[str]] = lambda _: ()
    """Lists the motions of a file that has several."""

    arrays: tuple[str, ...] = ()
    """Arrays that its files have."""

    is_text: bool = False

    is_recorded: bool = False
    """Whether its files are recordings of ROS: topics, and angles in [rad]."""

    writers: Mapping[str, Writer] = field(default_factory=dict)
    """By the names of the formats that they write."""


EVEN = 1e-6
"""Tolerance of evenly spaced times, in [s]."""

ONLY = "Only the motion's"
"""How a message begins that a file has fewer joints than the robot."""

BATCH = 1000
"""Samples per chunk when bodies are computed."""


def npz(arrays: Mapping[str, Any]) -> bytes:
    """Return an npz of arrays by name."""
    stream = io.BytesIO()
    np.savez(stream, **arrays)
    return stream.getvalue()


def number(rate: float) -> int | float:
    """Return a rate as an integer, where it is one: readers expect it."""
    return int(rate) if rate == int(rate) else rate


def prepared(
    motion: Motion,
    robot: Description,
    rate: float | None,
    names: Sequence[str] | None = None,
    has_joint_order: bool = True,
) -> tuple[Motion, float, tuple[str, ...]]:
    """Make a motion fit a format of even times that has a base and all joints.

    Args:
        motion: With a base; joints missing in it are at zero.
        robot: The robot.
        rate: Samples per second, in [Hz]; None: those of the motion, on average.
        names: Names of the format's joints, in its order; None: ``usual_joints``.
        has_joint_order: Whether files distinguish Unitree's 23 joints from ASAP's; if
            not, the robot's joints are written instead of Unitree's.

    Returns:
        The motion, its samples per second, and messages on changes: on joints at zero,
        on those that are left out, and on other times.

    Raises:
        MotionError: If it has no base or too many samples, or the robot lacks a joint.
    """
    if motion.base_poses is None:
        raise MotionError(
            "This format needs base poses, and the motion has none; write .csv."
        )
    own = [joint.name for joint in robot.movable_joints]
    names = usual_joints(motion, robot) if names is None else tuple(names)
    is_open = not has_joint_order and names == G1_JOINTS[23] and len(own) > len(names)
    names = tuple(own) if is_open else names
    lacking = [name for name in names if name not in own]
    if lacking:
        raise MotionError(
            f"This format needs joints that {robot.name} does not have: "
            f"{listed(lacking)}."
        )
    found, fps, resampled = even(
        replace(motion.arranged(names), notes=motion.notes), rate
    )
    notes = []
    missing = [name for name in names if name not in motion.joint_names]
    if missing:
        why = "; 23 joints could be read as ASAP's" if is_open else ""
        notes.append(f"Missing joints are written as 0: {listed(missing)}{why}.")
    left_out = [name for name in motion.joint_names if name not in names]
    if left_out:
        notes.append(
            f"Joints that the format does not have are not written: {listed(left_out)}."
        )
    if len(names) < len(own) and not notes:
        notes.append(f"{ONLY} {len(names)} joints are written, not all {len(own)}.")
    return found, fps, (*notes, *resampled)


def even_writer(
    make: Callable[[Motion, np.ndarray, Description, float], bytes],
    has_joint_order: bool = True,
    has_velocities: bool = True,
) -> Callable[[Motion, Description, float | None], tuple[bytes, tuple[str, ...]]]:
    """Make a writer's function for a format of even times, with a base and all joints.

    Args:
        make: Given such a motion, its base poses, the robot and the samples per second,
            returns the content.
        has_joint_order: As for ``prepared``.
        has_velocities: Whether the format has velocities; if not, a message says that
            those of the motion are not written.
    """

    def write(
        motion: Motion, robot: Description, rate: float | None
    ) -> tuple[bytes, tuple[str, ...]]:
        found, fps, notes = prepared(
            motion, robot, rate, has_joint_order=has_joint_order
        )
        if motion.velocities is not None and not has_velocities:
            lacking = "This format has no velocities: those of the motion are not"
            notes = (*notes, f"{lacking} written.")
        assert found.base_poses is not None
        return make(found, found.base_poses, robot, fps), notes

    return write


def usual_joints(motion: Motion, robot: Description) -> tuple[str, ...]:
    """Return the joints that are written, in the order of the robot's file.

    Those of the robot or, if the motion has exactly the joints of a smaller version of
    the G1, those.
    """
    own = tuple(joint.name for joint in robot.movable_joints)
    known = (own, ASAP_JOINTS, *G1_JOINTS.values())
    return next((n for n in known if {*n} == {*motion.joint_names}), own)


def even(motion: Motion, rate: float | None) -> tuple[Motion, float, tuple[str, ...]]:
    """Resample a motion to evenly spaced times, if necessary.

    Args:
        motion: The motion.
        rate: Samples per second, in [Hz]; None: those of the motion, on average.

    Returns:
        The motion, its samples per second, and a message if it was resampled.

    Raises:
        MotionError: If it would have too many samples, or the rate is not positive.
    """
    times = motion.times - motion.times[0]
    fps = mean_rate(motion, rate)
    try:
        found = motion.resampled(fps)
    except InvalidValueError as error:
        raise MotionError(str(error)) from error
    n_samples, regular = len(found.times), found.times - found.times[0]
    if n_samples == len(times) and np.abs(times - regular).max() <= EVEN:
        return motion, fps, ()
    is_even = len(times) < 2 or np.ptp(np.diff(times)) <= EVEN
    why = "Resampled" if is_even else "The times are not evenly spaced: resampled"
    note = f"{why} to {n_samples} samples at {fps:g} Hz."
    return found, fps, (note,)


def mean_rate(motion: Motion, rate: float | None) -> float:
    """Return the samples per second of a motion on average, or as given."""
    count = len(motion.times) - 1
    mean = count / motion.duration if count else 30.0
    return float(rate or (round(mean) if abs(mean - round(mean)) < 1e-3 else mean))


def bodies(motion: Motion, robot: Description) -> tuple[np.ndarray, np.ndarray]:
    """Place the root and the joints' child links.

    Args:
        motion: With a base and joints of the robot; others are at zero.
        robot: The robot.

    Returns:
        Poses, x y z and quaternion x y z w, shape (n_samples, n_joints + 1, 7), and
        twists along the map's axes, linear then angular, shape (..., 6).
    """
    child = {joint.name: joint.child for joint in robot.movable_joints}
    links = [robot.root, *(child[name] for name in motion.joint_names)]
    rows = [robot.link_names.index(link) for link in links]
    found = sample(motion, motion.times)
    base, base_twists = motion.base_poses, found.base_twists
    assert base is not None and base_twists is not None
    base_twists = _between(base_twists)
    velocities = velocities_of(motion)
    positions = of_robot(motion.joint_names, motion.positions, robot)
    velocities = of_robot(motion.joint_names, velocities, robot)
    kinematics = Kinematics(robot)
    shape = len(motion.times), len(links)
    poses, twists = np.empty((*shape, 7)), np.empty((*shape, 6))
    for begin in range(0, len(poses), BATCH):
        part = slice(begin, begin + BATCH)
        all_poses, all_twists = kinematics.link_states(
            base[part], positions[part], base_twists[part], velocities[part]
        )
        poses[part], twists[part] = all_poses[:, rows], all_twists[:, rows]
    poses[:, 0] = base
    return poses, twists


def velocities_of(motion: Motion) -> np.ndarray:
    """Return the velocities of joints, shape (n_samples, n_joints).

    Differences between samples, where the motion has none.
    """
    if motion.velocities is not None:
        return motion.velocities
    return _between(sample(motion, motion.times).velocities)


def _between(differences: np.ndarray) -> np.ndarray:
    """Average the velocities before and after each sample, shape (n, ...)."""
    if len(differences) < 2:
        return differences
    behind = np.concatenate([differences[:-1], differences[-2:-1]])
    before = np.concatenate([behind[:1], behind[:-1]])
    return 0.5 * (before + behind)
