"""Named poses: joint positions by name, whether they exist and suit a robot."""

from __future__ import annotations

import io
import re
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from ruamel.yaml import YAML, YAMLError
from ruamel.yaml.comments import CommentedMap
from ruamel.yaml.constructor import DuplicateKeyError
from ruamel.yaml.nodes import ScalarNode
from ruamel.yaml.representer import RoundTripRepresenter
from ruamel.yaml.scalarbool import ScalarBoolean

from g1_description.errors import InvalidValueError, PoseFileError, UnknownNameError
from g1_description.files.atomic import write_whole
from g1_description.files.model_files import PACKAGE, ros_home, share_folder
from g1_description.files.yaml import finite_number, yaml_problem
from g1_description.robot.description import Description, Joint
from g1_description.text import listed, similar_first

ZERO = "zero"
"""The pose that needs no file: every robot has it."""


@dataclass(frozen=True)
class Pose:
    """Where some joints of a robot are."""

    name: str

    positions: dict[str, float] = field(default_factory=dict)
    """Positions in [rad] or [m] by joint; the others are at 0.0."""

    about: str = ""
    """A line of text."""

    place: str = ""
    """The file it is from."""


def find_pose(name: str, poses: Mapping[str, Pose]) -> Pose:
    """Find a pose by its name.

    Raises:
        UnknownNameError: If there is none; its words begin with the nearest names.
    """
    if name not in poses:
        known = listed(similar_first(name, poses)) or "none"
        raise UnknownNameError(f"There is no pose '{name}'; there are {known}.")
    return poses[name]


def check_pose(pose: Pose, description: Description) -> None:
    """Check that a robot can take a pose.

    Args:
        pose: The pose.
        description: The robot.

    Raises:
        UnknownNameError: If it names a joint that the robot does not have, or that
            does not move.
        InvalidValueError: If a position is outside the joint's limits.
    """
    joints = {joint.name: joint for joint in description.movable_joints}
    owner = f"Pose {pose.name} of {pose.place}"
    for name, position in pose.positions.items():
        if name not in joints:
            known = listed(similar_first(name, joints)) or "none"
            raise UnknownNameError(
                f"{owner} names {name}, which is no movable joint of "
                f"'{description.name}'; there are {known}."
            )
        check_limits(owner, joints[name], position)


def check_limits(owner: str, joint: Joint, position: float) -> None:
    """Check that a joint can be somewhere.

    Args:
        owner: What has the position, for the message.
        joint: The joint.
        position: In [rad] or [m].

    Raises:
        InvalidValueError: If it cannot.
    """
    if not joint.lower <= position <= joint.upper:
        raise InvalidValueError(
            f"{owner} has {joint.name} at {position:g}, its limits are "
            f"{joint.lower:g} and {joint.upper:g}."
        )


def pose_positions(pose: Pose, description: Description) -> np.ndarray:
    """Give the positions of all joints of a robot in a pose.

    Args:
        pose: A pose that the robot can take.
        description: The robot.

    Returns:
        Positions in [rad] or [m], in the order of its movable joints; where a joint
        that is not named cannot be at 0.0, its nearest limit, shape (n_joints,).
    """
    joints = description.movable_joints
    positions = np.array([pose.positions.get(joint.name, 0.0) for joint in joints])
    lower = np.array([joint.lower for joint in joints])
    upper = np.array([joint.upper for joint in joints])
    return np.clip(positions, lower, upper)


def package_file() -> Path:
    """Give the package's own poses."""
    return share_folder() / "config" / "poses.yaml"


def user_file() -> Path:
    """Give the file of the user's own poses, which need not exist."""
    return ros_home() / PACKAGE / "poses.yaml"


def read_poses(file: Path | None = None) -> dict[str, Pose]:
    """Read the package's poses and the user's, who wins where both have a name.

    Args:
        file: A file that must exist; by default the user's, where there is one.

    Returns:
        The poses by name.

    Raises:
        G1DescriptionError: If a file cannot be read, or holds something else.
    """
    own = file or user_file()
    poses = read_file(package_file())
    if file or own.exists():
        poses.update(read_file(own))
    return poses


def read_file(file: Path) -> dict[str, Pose]:
    """Read one file.

    Raises:
        G1DescriptionError: If it cannot be read, or holds something else.
    """
    return parse_poses(_text_of(file), str(file))


def _text_of(file: Path) -> str:
    """Read a file's text."""
    try:
        # Not as text, for which Python would change the ends of lines.
        return file.read_bytes().decode("utf-8")
    except OSError as error:
        raise PoseFileError(
            f"The file of poses {file} cannot be read: {error.strerror}."
        ) from error
    except UnicodeDecodeError as error:
        raise PoseFileError(f"The file of poses {file} is not text: {error}.") from (
            error
        )


def save_pose(pose: Pose, file: Path) -> None:
    """Write a pose into a file, in the place of the one of its name if there is one.

    The file is there as a whole or as it was.

    Args:
        pose: What to write.
        file: Where to; it and its folder need not exist.

    Raises:
        G1DescriptionError: If it lies in the package, cannot be read or written.
    """
    file = file.resolve()
    if package_file().resolve().parents[1] in file.parents:
        raise PoseFileError(
            f"{file} lies in the package {PACKAGE}, which keeps its own poses; the "
            f"default is {user_file()}."
        )

    text = _text_of(file) if file.exists() else ""
    write_whole(file, with_pose(text, pose, str(file)).encode("utf-8"))


ABOUT = "about"
"""Key of a pose's line of text, which is no joint."""

MAX_LINE = 4096
"""Longest line before ruamel.yaml folds it, in characters."""

_NAME = re.compile(r"[A-Za-z][\w-]*", re.ASCII)


def parse_poses(text: str, place: str) -> dict[str, Pose]:
    """Read poses.

    Args:
        text: A file's text; an empty one has no poses.
        place: The file's name, for the messages.

    Returns:
        The poses by name, in the order of the file.

    Raises:
        PoseFileError: If the text has another form, or has a name twice.
        InvalidValueError: If a position is not a finite number.
    """
    content = _load(text, place)
    return {name: _pose(name, value, place) for name, value in content.items()}


def _load(text: str, place: str) -> CommentedMap:
    """Read YAML whose top level is a mapping; an empty text is an empty mapping."""
    try:
        # The round-trip reader knows each key's line, and takes aliases of aliases
        # in linear time.
        content = YAML().load(text)
    except (YAMLError, DuplicateKeyError, RecursionError, ValueError) as error:
        raise PoseFileError(
            f"The poses in {place} cannot be read, {yaml_problem(error)}."
        ) from error
    if content is None:
        return CommentedMap()
    if not isinstance(content, CommentedMap):
        raise PoseFileError(
            f"{place} must map names of poses to joints and their positions; it is "
            f"{_shown(content)}."
        )
    return content


def _pose(name: object, value: object, place: str) -> Pose:
    """Read one pose."""
    check_name(name)
    pose = f"Pose {name} of {place}"
    if not isinstance(value, CommentedMap):
        raise PoseFileError(
            f"{pose} must map joints to positions; it is {_shown(value)}."
        )
    joints = {key: position for key, position in value.items() if key != ABOUT}
    about = value.get(ABOUT, "")
    if not isinstance(about, str):
        raise PoseFileError(f"{pose}: {ABOUT} must be text, not {_shown(about)}.")
    for joint, position in joints.items():
        if not isinstance(joint, str):
            raise PoseFileError(f"{pose}: {joint!r} is not the name of a joint.")
        if isinstance(position, ScalarBoolean) or finite_number(position) is None:
            raise InvalidValueError(
                f"{pose}: the position of {joint} must be a finite number, not "
                f"{_shown(position)}."
            )
    positions = {str(joint): float(position) for joint, position in joints.items()}
    return Pose(str(name), positions, _one_line(about), place)


def _shown(value: object) -> str:
    """Return a value as a message shows it: a list may be endless, by its aliases."""
    if isinstance(value, CommentedMap):
        return "a mapping"
    return "a list" if isinstance(value, list) else repr(value)


def _one_line(text: str) -> str:
    """Put single spaces between the words of a text."""
    return " ".join(text.split())


def check_name(name: object) -> None:
    """Check that a pose can have a name.

    Raises:
        PoseFileError: If it cannot.
    """
    if not isinstance(name, str) or not _NAME.fullmatch(name):
        raise PoseFileError(
            f"A pose cannot be called {name!r}: names begin with a letter and contain "
            "only letters, digits, _ and -."
        )


def with_pose(text: str, pose: Pose, place: str) -> str:
    """Add a pose to a text, or replace the one of its name.

    All other lines stay as they are.

    Args:
        text: Poses, or nothing.
        pose: The pose to write.
        place: The file's name, for the messages.

    Returns:
        The new text.

    Raises:
        PoseFileError: If the text holds no poses, or in a form that cannot be edited.
        InvalidValueError: If a position in it is not a finite number.
    """
    pose = replace(pose, about=_one_line(pose.about), place=place)
    expected = {**parse_poses(text, place), pose.name: pose}
    written = _with_lines(text, _load(text, place), pose.name, _lines_of(pose))
    try:
        is_same = parse_poses(written, place) == expected
    except (PoseFileError, InvalidValueError):
        is_same = False
    if not is_same:
        raise PoseFileError(
            f"{place} is written in a form that cannot be edited: each pose must "
            "begin on a line of its own and refer to no other pose."
        )
    return written


def _with_lines(text: str, poses: CommentedMap, name: str, new: str) -> str:
    """Replace the lines of a pose, or add them at the end.

    The comments and empty lines after a pose belong to the next one.
    """
    end_of_line = "\r\n" if "\r\n" in text else "\n"
    new = new.replace("\n", end_of_line)
    if name not in poses:
        return text.rstrip() + 2 * end_of_line + new if text.strip() else new
    lines = text.splitlines(keepends=True)
    begin = poses.lc.key(name)[0]
    later = [poses.lc.key(other)[0] for other in poses]
    end = min((line for line in later if line > begin), default=len(lines))
    while end > begin + 1 and lines[end - 1].strip()[:1] in ("", "#"):
        end -= 1
    return "".join([*lines[:begin], new, *lines[end:]])


def _lines_of(pose: Pose) -> str:
    """Write one pose."""
    about = {ABOUT: pose.about} if pose.about else {}
    writer = YAML()
    writer.width = MAX_LINE  # type: ignore[assignment]
    writer.Representer = _Representer
    lines = io.StringIO()
    writer.dump({pose.name: {**about, **pose.positions}}, lines)
    return lines.getvalue()


class _Representer(RoundTripRepresenter):
    """Writes 1e-06 as 1.0e-06: YAML 1.1, which ROS reads, takes the former for text."""

    def represent_float(self, value: float) -> ScalarNode:
        """Write a finite number."""
        digits = repr(value)
        if "." not in digits:
            digits = digits.replace("e", ".0e")
        return self.represent_scalar("tag:yaml.org,2002:float", digits)


_Representer.add_representer(float, _Representer.represent_float)
