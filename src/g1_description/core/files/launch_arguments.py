"""What the launch files take: a mistake is reported before anything starts."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping
from pathlib import Path

from g1_description.core.errors import InvalidValueError, UnknownNameError
from g1_description.core.text import listed, similar_first

from .share import PACKAGE, share_folder

PHYSICS = ("kinematic", "hold", "limp")

CHOICES = {"sim": ("standin", "gazebo"), "physics": PHYSICS}
"""What there is, by argument."""

FLAGS = (
    "fixed_base",
    "paused",
    "use_sim_time",
    "respawn_gazebo",
    "gui",
    "ghost",
    "read_only",
    "robot_state_publisher",
    "loop",
    "web",
    "checks",
    "rviz",
)
"""Arguments that are true or false; roslaunch takes 1 and 0 for some of them, too."""

NUMBERS = ("x", "y", "z", "R", "P", "Y", "rate")
"""Arguments that are numbers; empty where they need not be given."""

FILES = ("motors", "thresholds", "rvizconfig")
"""Arguments that are files, empty where they need not be given."""

MAX_PORT = 65535


def check_arguments(given: Mapping[str, str]) -> None:
    """Check arguments that can be checked without the robot.

    Args:
        given: Values by name; those that are not known here are not checked.

    Raises:
        UnknownNameError: If something is requested that does not exist.
        InvalidValueError: If a number is none, or what is true or false is neither.
    """
    for name, choices in CHOICES.items():
        if given.get(name, choices[0]) not in choices:
            known = listed(similar_first(given[name], choices))
            raise UnknownNameError(
                f"There is no {name} '{given[name]}'; there are {known}."
            )
    for name in FLAGS:
        if given.get(name, "true").lower() not in ("true", "false", "1", "0"):
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
    base = given.get("base", "").split()
    if base and not (len(base) in (6, 7) and all(map(_is_finite, base))):
        raise InvalidValueError(
            f"base is '{given['base']}'; it is 'X Y Z YAW PITCH ROLL', six numbers in "
            "[m] and [rad]."
        )
    for name in FILES:
        if given.get(name):
            _check_file(name, Path(given[name]))
    port = given.get("port", "0")
    if not (port.isdecimal() and int(port) <= MAX_PORT):
        raise InvalidValueError(
            f"port is '{port}'; it is a whole number from 0 to {MAX_PORT}."
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
        raise InvalidValueError(f"{name} is '{file}', which is no full path{near}.")
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


def is_own_file(words: list[str]) -> bool:
    """Return whether roslaunch was given a launch file of this package.

    Args:
        words: The command line of roslaunch.
    """
    own = share_folder() / "launch"
    files = (Path(word) for word in words if word.endswith(".launch"))
    return PACKAGE in words or own in (file.resolve().parent for file in files)


def given_to_own_file(words: list[str]) -> dict[str, str]:
    """Return the arguments that roslaunch gives to a launch file of this package.

    In other files an argument of the same name may be anything.

    Args:
        words: The command line of roslaunch.

    Returns:
        Values by name, without those that are empty.
    """
    pairs = (word.partition(":=") for word in words if is_own_file(words))
    return {name: value for name, equals, value in pairs if equals and value}


def words_of_parent() -> list[str]:
    """Return the command line of the parent process; empty if it is unknown."""
    try:
        line = Path(f"/proc/{os.getppid()}/cmdline").read_bytes()
    except OSError:
        return []
    return os.fsdecode(line).split("\0")
