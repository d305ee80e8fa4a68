"""Named poses in YAML files, and whether they fit a robot."""

from __future__ import annotations

import io
import re
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from ruamel.yaml import YAML, YAMLError
from ruamel.yaml.comments import CommentedMap
from ruamel.yaml.constructor import DuplicateKeyError
from ruamel.yaml.nodes import ScalarNode
from ruamel.yaml.representer import RoundTripRepresenter
from ruamel.yaml.scalarbool import ScalarBoolean

from g1_description.choices import ZERO
from g1_description.errors import (
    G1DescriptionError,
    InvalidValueError,
    PoseFileError,
    UnknownNameError,
)
from g1_description.files.atomic import write_whole
from g1_description.files.model_files import PACKAGE, ros_home, share_folder
from g1_description.files.yaml import finite_number, yaml_problem
from g1_description.robot.description import Description, Joint, limits_of
from g1_description.text import listed, similar_first


@dataclass(frozen=True)
class Pose:
    """A named pose: positions of some joints."""

    name: str

    positions: dict[str, float] = field(default_factory=dict)
    """Positions in [rad] or [m] by joint; the others are at 0.0."""

    about: str = ""
    """Description in one line."""

    place: str = ""
    """The file of the pose."""

    keyframe: Mapping[str, Any] = field(default_factory=dict)
    """Of a keyframe: its ``time`` in [s] and ``base``, a pose in the map; of the first
    of a motion also ``through`` and ``fixed_links``; see ``ik.keyframes``."""


def find_pose(name: str, poses: Mapping[str, Pose]) -> Pose:
    """Find a pose by its name.

    Raises:
        UnknownNameError: If there is none; the message suggests similar names.
    """
    if name not in poses:
        known = listed(similar_first(name, poses)) or "none"
        raise UnknownNameError(f"Unknown pose '{name}'. Known poses: {known}.")
    return poses[name]


def check_pose(pose: Pose, description: Description) -> None:
    """Check that a pose fits a robot.

    Args:
        pose: The pose.
        description: The robot.

    Raises:
        UnknownNameError: If it contains an unknown or fixed joint.
        InvalidValueError: If a position is outside the joint's limits.
    """
    joints = {joint.name: joint for joint in description.movable_joints}
    owner = f"Pose {pose.name} of {pose.place}"
    for name, position in pose.positions.items():
        if name not in joints:
            known = listed(similar_first(name, joints)) or "none"
            raise UnknownNameError(
                f"{owner}: '{description.name}' has no movable joint '{name}'. Its "
                f"joints: {known}."
            )
        check_limits(owner, joints[name], position)


def check_limits(owner: str, joint: Joint, position: float) -> None:
    """Check that a position is within a joint's limits.

    Args:
        owner: Owner of the position, for the message.
        joint: The joint.
        position: In [rad] or [m].

    Raises:
        InvalidValueError: If it is outside.
    """
    if not joint.lower <= position <= joint.upper:
        raise InvalidValueError(
            f"{owner}: {joint.name} must be from {joint.lower:g} to {joint.upper:g} "
            f"(got {position:g})."
        )


def pose_positions(pose: Pose, description: Description) -> np.ndarray:
    """Return the positions of all joints of a robot in a pose.

    Args:
        pose: A pose that fits the robot.
        description: The robot.

    Returns:
        Positions in [rad] or [m], in the order of the movable joints, shape
        (n_joints,). Joints that are not in the pose are at 0.0, or at the nearest
        limit.
    """
    joints = description.movable_joints
    positions = np.array([pose.positions.get(joint.name, 0.0) for joint in joints])
    return np.clip(positions, *limits_of(joints))


def fits(pose: Pose, description: Description) -> bool:
    """Return whether a pose fits a robot, as by ``check_pose``."""
    try:
        check_pose(pose, description)
    except G1DescriptionError:
        return False
    return True


def user_file() -> Path:
    """Return the file of the user's poses of all robots, which need not exist."""
    return ros_home() / PACKAGE / "poses.yaml"


def fitting_poses(robot: Description) -> list[str]:
    """List the names of the poses that fit a robot, as by ``check_pose``."""
    return [name for name, pose in read_poses(robot).items() if fits(pose, robot)]


def read_poses(robot: Description, file: Path | None = None) -> dict[str, Pose]:
    """Read the poses of a robot: ``zero``, those of its profile, and the user's.

    The user's take precedence, unless only the profile's fits the robot.

    Args:
        robot: The robot.
        file: The user's file, which must exist; None: the usual one, if it exists.

    Returns:
        The poses by name; those of the user's other robots do not fit.

    Raises:
        G1DescriptionError: If a file cannot be read or is invalid.
    """
    poses = {ZERO: Pose(ZERO, about="all joints at 0", place="the package")}
    if robot.profile.poses:
        poses.update(read_file(robot.profile.poses))
    own = file or user_file()
    if file or own.exists():
        for name, pose in read_file(own).items():
            if name not in poses or fits(pose, robot):
                poses[name] = pose
    return poses


def read_file(file: Path) -> dict[str, Pose]:
    """Read one file.

    Raises:
        G1DescriptionError: If it cannot be read or is invalid.
    """
    return parse_poses(_text_of(file), str(file))


def _text_of(file: Path) -> str:
    """Read a file's text."""
    try:
        # As bytes, to keep line endings.
        return file.read_bytes().decode("utf-8")
    except OSError as error:
        raise PoseFileError(
            f"The file of poses {file} cannot be read: {error.strerror}."
        ) from error
    except UnicodeDecodeError as error:
        raise PoseFileError(
            f"The file of poses {file} is not UTF-8 text: {error}."
        ) from (error)


def save_pose(pose: Pose, file: Path) -> None:
    """Write a pose to a file, as by ``save_poses``."""
    save_poses([pose], file)


def save_poses(poses: Collection[Pose], file: Path, old: Collection[str] = ()) -> None:
    """Write poses to a file; poses of the same names are replaced.

    The file is written atomically.

    Args:
        poses: The poses.
        file: The file; it and its folder need not exist.
        old: Names of poses in the file that are removed.

    Raises:
        G1DescriptionError: If it is in the package, or cannot be read or written.
    """
    file = file.resolve()
    if share_folder().resolve() in file.parents:
        raise PoseFileError(
            f"Cannot save to {file}, which belongs to the package {PACKAGE}. The "
            f"default is {user_file()}."
        )

    text = _text_of(file) if file.exists() else ""
    changes = {**dict.fromkeys(old), **{pose.name: pose for pose in poses}}
    write_whole(file, _edited(text, changes, str(file)).encode("utf-8"))


ABOUT, KEYFRAME = "about", "keyframe"
"""Keys of a pose that are no joints: its description, and if it is a mapping, its time
and base."""

MAX_LINE = 4096
"""Longest line before ruamel.yaml folds it, in characters."""

_NAME = re.compile(r"[A-Za-z][\w-]*", re.ASCII)


def parse_poses(text: str, place: str) -> dict[str, Pose]:
    """Read poses.

    Args:
        text: A file's text; may be empty.
        place: The file's name, for the messages.

    Returns:
        The poses by name, in the order of the file.

    Raises:
        PoseFileError: If the text is invalid, or has a duplicate name.
        InvalidValueError: If a position is not a finite number.
    """
    content = _load(text, place)
    return {name: _pose(name, value, place) for name, value in content.items()}


def _load(text: str, place: str) -> CommentedMap:
    """Read YAML whose top level is a mapping; an empty text is an empty mapping."""
    try:
        # The round-trip reader knows each key's line, and handles nested aliases in
        # linear time.
        content = YAML().load(text)
    except (YAMLError, DuplicateKeyError, RecursionError, ValueError) as error:
        raise PoseFileError(
            f"The poses in {place} cannot be read: {yaml_problem(error)}."
        ) from error
    if content is None:
        return CommentedMap()
    if not isinstance(content, CommentedMap):
        raise PoseFileError(
            f"{place} must map names of poses to joint positions (got "
            f"{_shown(content)})."
        )
    return content


def _pose(name: object, value: object, place: str) -> Pose:
    """Read one pose."""
    check_name(name)
    pose = f"Pose {name} of {place}"
    if not isinstance(value, CommentedMap):
        raise PoseFileError(
            f"{pose} must map joints to positions (got {_shown(value)})."
        )
    joints, keyframe = {**value}, {}
    about = joints.pop(ABOUT, "")
    if isinstance(value.get(KEYFRAME), CommentedMap):
        keyframe = _keyframe(pose, joints.pop(KEYFRAME))
    if not isinstance(about, str):
        raise PoseFileError(f"{pose}: {ABOUT} must be text (got {_shown(about)}).")
    for joint, position in joints.items():
        if not isinstance(joint, str):
            raise PoseFileError(
                f"{pose}: names of joints must be text (got {joint!r})."
            )
        if isinstance(position, ScalarBoolean) or finite_number(position) is None:
            raise InvalidValueError(
                f"{pose}: the position of {joint} must be a finite number (got "
                f"{_shown(position)})."
            )
    positions = {str(joint): float(position) for joint, position in joints.items()}
    return Pose(str(name), positions, _one_line(about), place, keyframe)


def _keyframe(pose: str, given: CommentedMap) -> dict[str, Any]:
    """Read what a pose has as a keyframe."""
    base, links = given.get("base"), given.get("fixed_links", [])
    numbers = [given.get("time"), *(base if isinstance(base, list) else [])]
    is_bool = any(isinstance(number, ScalarBoolean) for number in numbers)
    if len(numbers) != 8 or is_bool or None in map(finite_number, numbers):
        raise PoseFileError(
            f"{pose}: a {KEYFRAME} must have a time in s, and a base, x y z and "
            "quaternion x y z w, of finite numbers."
        )
    texts = [given.get("through", ""), *(links if isinstance(links, list) else [None])]
    if not all(isinstance(text, str) for text in texts):
        raise PoseFileError(
            f"{pose}: through must be text, and fixed_links must be a list of names."
        )
    found = {"time": float(numbers[0]), "base": [float(n) for n in numbers[1:]]}
    given_texts = {"through": str(texts[0]), "fixed_links": [str(n) for n in texts[1:]]}
    return {**found, **{key: of for key, of in given_texts.items() if key in given}}


def _shown(value: object) -> str:
    """Format a value for a message; a list may be endless by aliases."""
    if isinstance(value, CommentedMap):
        return "a mapping"
    return "a list" if isinstance(value, list) else repr(value)


def _one_line(text: str) -> str:
    """Collapse white space to single spaces."""
    return " ".join(text.split())


def check_name(name: object) -> None:
    """Check the name of a pose, or of a file.

    Raises:
        PoseFileError: If it is invalid.
    """
    if not isinstance(name, str) or not _NAME.fullmatch(name):
        raise PoseFileError(
            f"Invalid name: {name!r}. Names must begin with a letter and contain only "
            "letters, digits, _ and -."
        )


def with_pose(text: str, pose: Pose, place: str) -> str:
    """Add a pose to a text, or replace the one of the same name.

    All other lines are kept.

    Args:
        text: Poses, or nothing.
        pose: The pose to write.
        place: The file's name, for the messages.

    Returns:
        The new text.

    Raises:
        PoseFileError: If the text is invalid, or in a form that cannot be edited.
        InvalidValueError: If a position in it is not a finite number.
    """
    return _edited(text, {pose.name: pose}, place)


def _edited(text: str, changes: Mapping[str, Pose | None], place: str) -> str:
    """Write poses as in ``with_pose``; None: remove that of the name."""
    expected, new = parse_poses(text, place), {}
    for name, pose in changes.items():
        if pose is None:
            del expected[name]
            new[name] = ""
        else:
            pose = replace(pose, about=_one_line(pose.about), place=place)
            expected[name], new[name] = pose, _written(pose)
    written = _with_lines(text, _load(text, place), new)
    try:
        is_same = parse_poses(written, place) == expected
    except (PoseFileError, InvalidValueError):
        is_same = False
    if not is_same:
        raise PoseFileError(
            f"{place} cannot be edited: each pose must begin on its own line, without "
            "references to other poses."
        )
    return written


def _written(pose: Pose) -> str:
    """Write the lines of a pose."""
    content: dict[str, object] = {ABOUT: pose.about} if pose.about else {}
    if pose.keyframe:
        line = CommentedMap(pose.keyframe)
        line.fa.set_flow_style()
        content[KEYFRAME] = line
    writer = YAML()
    writer.width = MAX_LINE  # type: ignore[assignment]
    writer.Representer = _Representer
    lines = io.StringIO()
    writer.dump({pose.name: {**content, **pose.positions}}, lines)
    return lines.getvalue()


def _with_lines(text: str, poses: CommentedMap, new: Mapping[str, str]) -> str:
    """Replace the lines of poses, or add them at the end.

    Comments and empty lines after a pose belong to the next one.
    """
    end_of_line = "\r\n" if "\r\n" in text else "\n"
    new = {name: own.replace("\n", end_of_line) for name, own in new.items()}
    lines = text.splitlines(keepends=True)
    begins = {name: poses.lc.key(name)[0] for name in poses}
    known = [name for name in new if name in begins]
    # From the last one on: the lines of those before stay where they are.
    for name in sorted(known, key=lambda name: begins[name], reverse=True):
        begin = begins[name]
        later = (line for line in begins.values() if line > begin)
        end = min(later, default=len(lines))
        while end > begin + 1 and lines[end - 1].strip()[:1] in ("", "#"):
            end -= 1
        lines[begin:end] = [new[name]]
    text = "".join(lines)
    for name, own in new.items():
        if name not in begins:
            text = text.rstrip() + 2 * end_of_line + own if text.strip() else own
    return text


class _Representer(RoundTripRepresenter):
    """Writes 1e-06 as 1.0e-06: in YAML 1.1, as used by ROS, the former is text."""

    def represent_float(self, value: float) -> ScalarNode:
        """Write a finite number."""
        digits = repr(value)
        if "." not in digits:
            digits = digits.replace("e", ".0e")
        return self.represent_scalar("tag:yaml.org,2002:float", digits)


_Representer.add_representer(float, _Representer.represent_float)
