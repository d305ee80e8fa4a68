"""What the launch files take: a mistake is reported before anything starts."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from xml.etree import ElementTree

from g1_description.bounds import MAX_PORT
from g1_description.errors import InvalidValueError, UnknownNameError
from g1_description.files.model_files import PACKAGE, share_folder
from g1_description.robot.description import Description
from g1_description.text import listed, similar_first

PHYSICS = ("kinematic", "hold", "limp")

CHOICES = {"sim": ("standin", "gazebo"), "physics": PHYSICS}
"""What there is, by argument."""

BOOLEANS = {
    **dict.fromkeys(
        ("fixed_base", "paused", "use_sim_time", "respawn_gazebo"), ("true", "false")
    ),
    **dict.fromkeys(
        ("ghost", "web", "read_only", "checks", "rviz", "loop"),
        ("true", "false", "1", "0"),
    ),
}
"""Arguments that are true or false, and the words that roslaunch takes for that."""

NUMBERS = ("x", "y", "z", "R", "P", "Y", "rate")
"""Arguments that are numbers; empty where they need not be given."""

FILES = ("motors", "thresholds", "rvizconfig")
"""Arguments that are files, empty where they need not be given."""


def check_arguments(given: Mapping[str, str]) -> None:
    """Check arguments that can be checked without the robot.

    Args:
        given: Values by name; those that are not known here are not checked.

    Raises:
        UnknownNameError: If something is requested that does not exist.
        InvalidValueError: If a value is none that the argument can have.
    """
    for name, choices in CHOICES.items():
        if given.get(name, choices[0]) not in choices:
            known = listed(similar_first(given[name], choices))
            raise UnknownNameError(
                f"There is no {name} '{given[name]}'; there are {known}."
            )
    for name, words in BOOLEANS.items():
        if given.get(name, "true").lower() not in words:
            raise InvalidValueError(
                f"{name} is '{given[name]}'; it is either true or false."
            )
    for name in NUMBERS:
        if given.get(name):
            _check_number(name, given[name])
    if not 0.0 <= float(given.get("rate") or 0.0) <= 1e6:
        raise InvalidValueError(
            f"rate is {given['rate']}; it is a number of states per second, at most "
            "1e6, or 0 for all there are."
        )
    for name in FILES:
        if given.get(name):
            _check_file(name, Path(given[name]))
    _check_port(given.get("port", "0"))
    _check_base(given.get("base", ""))


def check_trails(
    name: str, links: Sequence[str], robots: Sequence[Description]
) -> None:
    """Check that each link whose path is wanted is one of a robot.

    Args:
        name: Of the argument or parameter that has the links.
        links: The links.
        robots: The robots.

    Raises:
        UnknownNameError: If a link is none of theirs.
    """
    names = dict.fromkeys(link for robot in robots for link in robot.link_names)
    unknown = [link for link in links if link not in names]
    if unknown:
        near = listed(similar_first(unknown[0], names))
        raise UnknownNameError(
            f"{name} has {listed(unknown)}, which no robot has; there are {near}."
        )


def _check_port(text: str) -> None:
    """Check that a text is the number of a port."""
    if not (text.isdecimal() and int(text) <= MAX_PORT):
        raise InvalidValueError(
            f"port is '{text}'; it is a whole number from 0 to {MAX_PORT}."
        )


def _check_base(text: str) -> None:
    """Check that a text is a place, as static_transform_publisher of tf takes it."""
    words = text.split()
    if words and not (len(words) in (6, 7) and all(map(_is_finite, words))):
        raise InvalidValueError(
            f"base is '{text}'; it is 'X Y Z YAW PITCH ROLL', six numbers in [m] and "
            "[rad], or seven with a quaternion."
        )


def _is_finite(text: str) -> bool:
    """Return whether a text is a finite number."""
    try:
        return math.isfinite(float(text))
    except ValueError:
        return False


def _check_number(name: str, text: str) -> None:
    """Check that a text is a finite number."""
    if not _is_finite(text):
        raise InvalidValueError(f"{name} is '{text}', which is no finite number.")


def _check_file(name: str, file: Path) -> None:
    """Check that there is a file: nodes run in a folder other than roslaunch's."""
    if not file.is_absolute():
        near = f"; {file.resolve()} is" if file.is_file() else ""
        raise InvalidValueError(
            f"{name} is '{file}', which is not an absolute path{near}."
        )
    if not file.is_file():
        raise UnknownNameError(f"There is no file {file}, which {name} names.")


def check_for_empty(given: Mapping[str, str], words: list[str]) -> None:
    """Check that no argument was given without a value.

    roslaunch drops such a one, as ``model:=$MODEL`` without that variable, and takes
    the default.

    Args:
        given: Values by name, as roslaunch has them.
        words: Its command line.

    Raises:
        InvalidValueError: If one is empty that has a default, or must have a value.
    """
    for name, value in given.items():
        if value and f"{name}:=" in words:
            raise InvalidValueError(f"{name}:= is empty; without it, {value} is taken.")


def own_file(words: list[str]) -> Path | None:
    """Find the launch file of this package that roslaunch was given.

    Args:
        words: The command line of roslaunch.

    Returns:
        Its path; None if it was given others' files alone.
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

    In other files an argument of the same name may be anything.

    Args:
        words: The command line of roslaunch.

    Returns:
        Values by name, of those arguments that the file has; without empty ones.
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
