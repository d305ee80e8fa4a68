"""Validation of launch arguments, before any node starts."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from xml.etree import ElementTree

from g1_description.choices import ENGINES, MAX_PORT, PHYSICS
from g1_description.errors import InvalidValueError, UnknownNameError
from g1_description.files.model_files import PACKAGE, find_folder, share_folder
from g1_description.robot.description import Description
from g1_description.robot.profile import FILE, is_name
from g1_description.text import listed, similar_first

LOWEST_FOOT = "lowest_foot"
"""Anchor that is the lower one of the robot's feet."""

FEET = ("left_foot", "right_foot")
"""Roles of the feet in a robot's profile."""

CHOICES = {"sim": ("standin", "gazebo"), "physics": PHYSICS, "engine": ENGINES}
"""Allowed values by argument."""

STAND_IN_ONLY = {
    "physics": PHYSICS[0],
    "engine": ENGINES[0],
    "motors": "",
    "fixed_base": "false",
}
"""Defaults of the arguments that nothing but the stand-in has. ``anchor`` is another
one, which a package in Gazebo's place may have, too."""

BOOLEANS = {
    **dict.fromkeys(
        ("fixed_base", "paused", "use_sim_time", "respawn_gazebo"), ("true", "false")
    ),
    **dict.fromkeys(
        ("ghost", "web", "read_only", "checks", "interactive", "rviz", "loop"),
        ("true", "false", "1", "0"),
    ),
}
"""Boolean arguments, with the words that roslaunch accepts."""

NUMBERS = ("x", "y", "z", "R", "P", "Y", "rate")
"""Arguments that are numbers or empty."""

FILES = ("scene", "motors", "collisions", "thresholds", "rvizconfig")
"""Arguments that are files or empty; ``motors`` may be a name of the profile's."""


def check_arguments(given: Mapping[str, str]) -> None:
    """Check arguments that can be checked without the robot.

    Args:
        given: Values by name; unknown arguments are not checked.

    Raises:
        UnknownNameError: If a value or file does not exist.
        InvalidValueError: If a value is invalid.
    """
    for name, choices in CHOICES.items():
        if given.get(name, choices[0]) not in choices:
            known = listed(similar_first(given[name], choices))
            raise UnknownNameError(
                f"Unknown {name} '{given[name]}'. Known values: {known}."
            )
    for name, words in BOOLEANS.items():
        if given.get(name, "true").lower() not in words:
            raise InvalidValueError(
                f"{name} must be true or false (got '{given[name]}')."
            )
    wrong = [n for n in NUMBERS if given.get(n) and not _is_finite(given[n])]
    if wrong:
        raise InvalidValueError(
            f"{wrong[0]} must be a number (got '{given[wrong[0]]}')."
        )
    if not 0.0 <= float(given.get("rate") or 0.0) <= 1e6:
        raise InvalidValueError(
            "rate must be from 0 to 1e6 states per second, 0 for all (got "
            f"{given['rate']})."
        )
    for name in FILES:
        file = given.get(name)
        if file and not (name == "motors" and is_name(file)):
            _check_file(name, Path(file))
    for name, default in STAND_IN_ONLY.items() if given.get("sim") == "gazebo" else ():
        if given.get(name, default).lower() != default:
            raise InvalidValueError(
                f"{name}:={given[name]} has no effect with sim:=gazebo; leave it out, "
                "or use sim:=standin."
            )
    _check_profile(given.get("robot", ""))
    port = given.get("port", "0")
    if not (port.isdecimal() and int(port) <= MAX_PORT):
        raise InvalidValueError(
            f"port must be a whole number from 0 to {MAX_PORT} (got '{port}')."
        )
    _check_base(given.get("base", ""))
    if given.get("sim") == "gazebo":
        _check_gazebo()


def check_trails(
    name: str, links: Sequence[str], robots: Sequence[Description]
) -> None:
    """Check that links of trails exist.

    Args:
        name: Name of the argument or parameter.
        links: The links.
        robots: The robots.

    Raises:
        UnknownNameError: If no robot has a link.
    """
    names = dict.fromkeys(link for robot in robots for link in robot.link_names)
    unknown = [link for link in links if link not in names]
    if unknown:
        near = listed(similar_first(unknown[0], names))
        raise UnknownNameError(
            f"Unknown link {listed(unknown)} in {name}. Known links: {near}."
        )


def _check_gazebo() -> None:
    """Check that the real Gazebo is installed, not this package's gazebo_ros alone."""
    folder = find_folder("gazebo_ros")
    if folder is not None:
        manifest = Path(folder, "package.xml").read_text("utf-8", "replace")
        if f"<exec_depend>{PACKAGE}<" not in manifest:
            return
    raise UnknownNameError(
        "sim:=gazebo needs the real Gazebo, whose package gazebo_ros is missing; "
        "install ros-noetic-gazebo-ros and build the workspace again, or use "
        "sim:=standin."
    )


def _check_profile(text: str) -> None:
    """Check that the folder of a profile is an absolute path, as for files."""
    folder = Path(os.path.expanduser(text))
    if text and not folder.is_absolute() and (folder / FILE).is_file():
        raise InvalidValueError(
            f"robot must be a profile's name or an absolute path (got '{text}'); use "
            f"{folder.resolve()}."
        )


def _check_base(text: str) -> None:
    """Check that a text is a transform, as for static_transform_publisher of tf."""
    words = text.split()
    if words and not (len(words) in (6, 7) and all(map(_is_finite, words))):
        raise InvalidValueError(
            "base must be 'X Y Z YAW PITCH ROLL' in [m] and [rad], or seven numbers "
            f"with a quaternion (got '{text}')."
        )


def _is_finite(text: str) -> bool:
    """Return whether a text is a finite number."""
    try:
        return math.isfinite(float(text))
    except ValueError:
        return False


def _check_file(name: str, file: Path) -> None:
    """Check that a file exists; nodes run in another folder than roslaunch."""
    if not file.is_absolute():
        near = f"; use {file.resolve()}" if file.is_file() else ""
        raise InvalidValueError(
            f"{name} must be an absolute path (got '{file}'){near}."
        )
    if not file.is_file():
        raise UnknownNameError(f"The file {file} of {name} does not exist.")


def check_for_empty(given: Mapping[str, str], words: list[str]) -> None:
    """Check that no argument was given without a value.

    roslaunch ignores these, such as ``model:=$MODEL`` without that variable, and uses
    the default.

    Args:
        given: Values by name, as roslaunch has them.
        words: Its command line.

    Raises:
        InvalidValueError: If one is empty.
    """
    for name, value in given.items():
        if value and f"{name}:=" in words:
            raise InvalidValueError(
                f"{name}:= is empty; leave it out to use the default, {value}."
            )


def own_file(words: list[str]) -> Path | None:
    """Find the launch file of this package that roslaunch was given.

    Args:
        words: The command line of roslaunch.

    Returns:
        Its path; None if it was given only other files.
    """
    folder = share_folder() / "launch"
    for word in words:
        file = folder / word if PACKAGE in words else Path(word).resolve()
        is_own = file.resolve().parent == folder and file.suffix == ".launch"
        if is_own and file.is_file():
            return file
    return None


def given_to_own_file(words: list[str]) -> dict[str, str]:
    """Return the arguments that roslaunch gives to a launch file of this package.

    In other launch files, arguments of these names may have other meanings.

    Args:
        words: The command line of roslaunch.

    Returns:
        Values by name of the file's arguments, without empty ones.
    """
    file = own_file(words)
    if file is None:
        return {}
    names = {arg.get("name") for arg in ElementTree.parse(file).iter("arg")}
    pairs = (word.partition(":=") for word in words)
    return {n: value for n, equals, value in pairs if equals and value and n in names}


def words_of_parent() -> list[str]:
    """Return the command line of the parent process; empty if it is unknown."""
    try:
        line = Path(f"/proc/{os.getppid()}/cmdline").read_bytes()
    except OSError:
        return []
    return os.fsdecode(line).split("\0")
