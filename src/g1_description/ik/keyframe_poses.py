"""Keyframes as programs give them, and as files of poses have them."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from os import PathLike
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from g1_description.choices import ZERO
from g1_description.errors import (
    G1DescriptionError,
    InvalidValueError,
    PoseFileError,
    UnknownNameError,
)
from g1_description.ik.posing import roles_of
from g1_description.motion.edit import projected
from g1_description.motion.motion import Motion
from g1_description.robot.arrays import as_array, as_numbers, one_pose
from g1_description.robot.assembly import WORLD, root_in_base
from g1_description.robot.description import Description, limits_of
from g1_description.robot.kinematics import Kinematics
from g1_description.robot.launch_arguments import FEET
from g1_description.robot.poses import (
    Pose,
    check_name,
    check_pose,
    find_pose,
    pose_positions,
    read_file,
    read_poses,
    save_poses,
    user_file,
)
from g1_description.robot.transform import IDENTITY, compose, inverse
from g1_description.sim.standing import standing_base
from g1_description.text import listed, similar_first

STOP, PASS = "stop", "pass"
"""Ways through keyframes: from rest to rest with minimum jerk, or a cubic spline."""


class Keyframe(NamedTuple):
    """A configuration at a time."""

    time: float
    """In [s]."""

    positions: np.ndarray
    """Positions in [rad] or [m], clipped to the limits, shape (n_joints,)."""

    base: np.ndarray
    """Pose of the base link in the map, shape (7,)."""


@dataclass(frozen=True, eq=False)
class Keyframes:
    """Keyframes of a robot, and the motion through them."""

    robot: Description

    frames: tuple[Keyframe, ...]
    """Later than given where the motion would be too fast."""

    fixed_links: tuple[str, ...] | None
    """Links that stay between keyframes in which they are at one place; None: the
    profile's feet."""

    through: str
    """``stop`` or ``pass``."""

    motion: Motion
    """With the base, 50 samples per second."""

    message: str
    """Sentences on the first keyframe that is later than given, what is too fast even
    so, and the first link that does not stay; empty if there is none."""

    @property
    def times(self) -> tuple[float, ...]:
        """Times of the keyframes in [s]."""
        return tuple(frame.time for frame in self.frames)

    def save(self, path: str | PathLike[str], name: str | None = None) -> None:
        """Write the keyframes to a file of poses, as NAME_1, NAME_2 and so on.

        Args:
            path: The file. Keyframes and poses of these names are replaced; all else in
                it stays.
            name: NAME; None: that of the file.

        Raises:
            G1DescriptionError: If the name is invalid, or the file cannot be written.
        """
        file = Path(path).expanduser()
        name = file.stem if name is None else name
        poses = self.poses(name)
        before = _saved(file).get(name, []) if file.exists() else []
        old = {pose.name for pose in before} - {pose.name for pose in poses}
        save_poses(poses, file, old)

    def poses(self, name: str) -> list[Pose]:
        """Return the keyframes as poses NAME_1, NAME_2 and so on.

        Raises:
            PoseFileError: If the name is invalid.
        """
        check_name(name)
        poses = []
        for number, (time, positions, base) in enumerate(self.frames, 1):
            joints = {
                joint.name: min(max(round(position, 6), joint.lower), joint.upper)
                for joint, position in zip(
                    self.robot.movable_joints, positions.tolist()
                )
            }
            keyframe: dict[str, Any] = {
                "time": round(time, 6),
                "base": [round(value, 6) for value in base.tolist()],
            }
            if number == 1:
                keyframe["through"] = self.through
            if number == 1 and self.fixed_links is not None:
                keyframe["fixed_links"] = [*self.fixed_links]
            poses.append(Pose(f"{name}_{number}", joints, "keyframe", "", keyframe))
        return poses


def keyframes_at(
    robot: Description,
    entries: Iterable[Any],
    times: Any,
    fixed_links: Collection[str] | None = None,
) -> list[Keyframe]:
    """Read keyframes that a program gives.

    Args:
        robot: The robot.
        entries: As for ``Robot.keyframes``.
        times: In [s], shape (n,).
        fixed_links: As for ``keyframe_pieces``; the first one places entries without
            a base.

    Raises:
        UnknownNameError: If a pose, joint or link is unknown.
        InvalidValueError: If entries or times have other shapes, or are not finite.
    """
    if isinstance(entries, (str, Mapping)) or not isinstance(entries, Iterable):
        raise InvalidValueError(f"Keyframes must be a list (got {str(entries)[:80]}).")
    given, stamps = [*entries], as_numbers(times, "times")
    if stamps.shape != (len(given),):
        raise InvalidValueError(
            f"Each of the {len(given)} keyframes needs a time (got times of shape "
            f"{stamps.shape})."
        )
    links = fixed_link_names(robot, fixed_links)
    frames: list[Keyframe] = []
    for number, (time, entry) in enumerate(zip(stamps.tolist(), given), 1):
        try:
            positions, base = _placed(robot, entry)
        except G1DescriptionError as error:
            raise type(error)(f"Keyframe {number}: {error}") from error
        if base is None:
            before = frames[-1] if frames else None
            base = _standing(robot, positions, before, links)
        frames.append(Keyframe(time, positions, base))
    return frames


def _placed(robot: Description, entry: Any) -> tuple[np.ndarray, np.ndarray | None]:
    """Read positions within limits, and the base of an entry; None: it has none."""
    base = None
    if hasattr(entry, "positions") and hasattr(entry, "base"):
        entry, base = entry.positions, entry.base
    elif (
        isinstance(entry, tuple)
        and len(entry) == 2
        and not isinstance(entry[1], (int, float, np.number))
    ):
        entry, base = entry
    if isinstance(entry, str):
        pose = find_pose(entry, read_poses(robot))
        check_pose(pose, robot)
        if base is None:
            base = pose.keyframe.get("base")
        entry = pose_positions(pose, robot)
    joints = robot.movable_joints
    names = [joint.name for joint in joints]
    positions = as_array(entry, names, pose_positions(Pose(ZERO), robot))
    if positions.ndim != 1:
        raise InvalidValueError(
            f"Positions must be a single configuration (got shape {positions.shape})."
        )
    positions = np.clip(positions, *limits_of(joints))
    return positions, None if base is None else one_pose(base)


def _standing(
    robot: Description,
    positions: np.ndarray,
    before: Keyframe | None,
    links: Sequence[str],
) -> np.ndarray:
    """Stand on the floor upright, the first link where it is in the keyframe before."""
    if robot.root == WORLD or not {*FEET} & {*roles_of(robot)}:
        return before.base if before else IDENTITY
    names = [joint.name for joint in robot.movable_joints]
    base = standing_base(robot, dict(zip(names, positions.tolist())))
    if before is None:
        return base
    bases = np.stack([before.base, base])
    joints = np.stack([before.positions, positions])
    poses = Kinematics(robot).link_poses(compose(bases, root_in_base(robot)), joints)
    rows = [robot.link_names.index(link) for link in links[:1]]
    place, now = map(projected, poses[:, rows[0]] if rows else bases)
    return compose(compose(place, inverse(now)), base)


def fixed_link_names(robot: Description, given: Collection[str] | None) -> list[str]:
    """Find the fixed links, given by name or role; None: the profile's feet.

    Raises:
        UnknownNameError: If a link is unknown.
        InvalidValueError: If they are no names.
    """
    roles = roles_of(robot)
    names = [foot for foot in FEET if foot in roles] if given is None else given
    if isinstance(names, str) or not all(isinstance(name, str) for name in names):
        raise InvalidValueError(
            "fixed_links must be a list of names or roles of links (got "
            f"{str(given)[:80]})."
        )
    links = [roles.get(name, name) for name in names]
    known = [name for name in robot.link_names if name != WORLD]
    for name in links:
        if name not in known:
            near = listed(similar_first(name, [*roles, *known]))
            raise UnknownNameError(f"Unknown link '{name}'. Known links: {near}.")
    return links


def saved_keyframes(
    robot: Description, path: str | PathLike[str] | None, name: str | None
) -> tuple[list[Keyframe], list[str] | None, str]:
    """Read keyframes of a file, with ``fixed_links`` and ``through``.

    Args:
        robot: The robot.
        path: As for ``Robot.read_keyframes``.
        name: Likewise.

    Raises:
        G1DescriptionError: If the file cannot be read, has no such keyframes, or they
            do not fit the robot.
    """
    file = user_file() if path is None else Path(path).expanduser()
    saved = _saved(file)
    if not saved:
        raise PoseFileError(
            f"{file} has no keyframes, which are poses with times, such as pick_1."
        )
    if name is None and len(saved) == 1:
        (name,) = saved
    if name not in saved:
        raise UnknownNameError(
            f"name must be one of {listed(saved)}: {file} has no other keyframes (got "
            f"{name})."
        )
    keys = []
    for pose in saved[name]:
        check_pose(pose, robot)
        keys.append((pose_positions(pose, robot), pose.keyframe))
    entries = [(positions, key["base"]) for positions, key in keys]
    first = keys[0][1]
    frames = keyframes_at(robot, entries, [key["time"] for _, key in keys])
    return frames, first.get("fixed_links"), first.get("through", STOP)


def _saved(file: Path) -> dict[str, list[Pose]]:
    """Find the keyframes of a file by their common name, in the order of numbers."""
    found: dict[str, dict[int, Pose]] = {}
    for pose in read_file(file).values():
        match = re.fullmatch(r"(.+)_([1-9]\d*)", pose.name)
        if match and pose.keyframe:
            found.setdefault(match[1], {})[int(match[2])] = pose
    return {
        name: [poses[number] for number in sorted(poses)]
        for name, poses in found.items()
    }
