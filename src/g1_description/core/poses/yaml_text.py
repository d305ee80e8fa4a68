"""Poses as YAML text: the one module that knows it.

A file maps names of poses to joints, and joints to positions in [rad] or [m]; joints
that a pose does not name are at 0.0.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import replace

import yaml

from g1_description.core.errors import InvalidValueError, PoseFileError

from .pose import Pose

ABOUT = "about"
"""Key of a pose's line of text, which is no joint."""

_NAME = re.compile(r"[A-Za-z][\w-]*", re.ASCII)


class _Loader(yaml.SafeLoader):
    """A reader of YAML that refuses a key that stands twice in a mapping."""

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict:
        """Read a mapping."""
        seen = set()
        for key, _ in node.value:
            if not isinstance(key, yaml.ScalarNode):
                continue
            if key.value in seen:
                raise yaml.constructor.ConstructorError(
                    problem=f"{key.value!r} stands there twice",
                    problem_mark=key.start_mark,
                )
            seen.add(key.value)
        return super().construct_mapping(node, deep)


def parse_poses(text: str, place: str) -> dict[str, Pose]:
    """Read poses.

    Args:
        text: A file's text; an empty one has no poses.
        place: The file's name, for the sentences.

    Returns:
        The poses by name, in the order of the file.

    Raises:
        PoseFileError: If the text is not of that form, or names something twice.
        InvalidValueError: If a position is not a finite number.
    """
    try:
        content = yaml.load(text, _Loader)
    except yaml.MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        where = f", line {mark.line + 1}" if mark else ""
        raise PoseFileError(
            f"The poses of {place} cannot be read{where}: {error.problem}."
        ) from error
    except (yaml.YAMLError, RecursionError) as error:
        what = str(error).splitlines()[0]
        raise PoseFileError(f"The poses of {place} cannot be read: {what}.") from error
    if content is not None and not isinstance(content, dict):
        raise PoseFileError(
            f"{place} holds a {type(content).__name__}, it must map names of poses to "
            "joints and their positions."
        )
    return {name: _pose(name, told, place) for name, told in (content or {}).items()}


def _pose(name: object, told: object, place: str) -> Pose:
    """Read one pose."""
    check_name(name)
    if not isinstance(told, dict):
        raise PoseFileError(
            f"Pose {name} of {place} is {told!r}, it must map joints to positions."
        )
    joints = {key: value for key, value in told.items() if key != ABOUT}
    about = told.get(ABOUT, "")
    if not isinstance(about, str):
        raise PoseFileError(
            f"Pose {name} of {place} has {ABOUT}: {about!r}, it must be a text."
        )
    for joint, value in joints.items():
        if not isinstance(joint, str):
            raise PoseFileError(
                f"Pose {name} of {place} has {joint!r} for the name of a joint."
            )
        if type(value) not in (int, float) or not math.isfinite(value):
            raise InvalidValueError(
                f"Pose {name} of {place} has {joint} at {value!r}, which is no finite "
                "number."
            )
    positions = {joint: float(value) for joint, value in joints.items()}
    return Pose(str(name), positions, _one_line(about), place)


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
            f"A pose cannot be called {name!r}: names begin with a letter and have "
            "letters, digits, _ and -."
        )


def with_pose(text: str, pose: Pose, place: str) -> str:
    """Put a pose into a text, in the place of the one of its name if there is one.

    All other lines stay as they are.

    Args:
        text: Poses, or nothing.
        pose: What to put there.
        place: The file's name, for the sentences.

    Returns:
        The new text.

    Raises:
        PoseFileError: If the text holds no poses, or in a form that cannot be added to.
        InvalidValueError: If a position in it is not a finite number.
    """
    pose = replace(pose, about=_one_line(pose.about))
    wanted = {**parse_poses(text, place), pose.name: pose}
    about = {ABOUT: pose.about} if pose.about else {}
    told = {pose.name: {**about, **pose.positions}}
    block = yaml.safe_dump(told, sort_keys=False, allow_unicode=True, width=1000)
    written = _with_block(text, pose.name, block)
    try:
        same = _content(parse_poses(written, place)) == _content(wanted)
    except PoseFileError:
        same = False
    if not same:
        raise PoseFileError(
            f"{place} is written in a form that cannot be added to: each pose must "
            "begin a line of its own and refer to no other."
        )
    return written


def _with_block(text: str, name: str, block: str) -> str:
    """Put the lines of a pose where those of its name are, or at the end."""
    root = yaml.compose(text, yaml.SafeLoader)
    for key, value in root.value if root else ():
        if key.value == name:
            entries = value.value if isinstance(value, yaml.MappingNode) else ()
            # A mapping's own end is where the next one begins, beyond the comments.
            last = entries[-1][1] if entries else value
            before, after = text[: key.start_mark.index], text[last.end_mark.index :]
            return before + block + after.partition("\n")[2]
    return f"{text.rstrip()}\n\n{block}" if text.strip() else block


def _content(poses: Mapping[str, Pose]) -> dict[str, tuple[dict[str, float], str]]:
    """Tell what poses are, apart from where they are from."""
    return {name: (pose.positions, pose.about) for name, pose in poses.items()}
