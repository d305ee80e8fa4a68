"""Options of the command pose, without what moves robots: help needs nothing else."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from g1_description.choices import ZERO
from g1_description.cli import options
from g1_description.command_line import (
    argument,
    option,
    own_arguments,
    parse,
    within,
)
from g1_description.errors import InvalidValueError

USER_FILE = "~/.ros/g1_description/poses.yaml"


@dataclass(frozen=True)
class PoseOptions:
    """Move a robot to a named pose, list the poses, or save one."""

    name: str | None = argument(
        "pose to go to", str, nargs="?", metavar="NAME", default=None
    )
    list: bool = option(
        "list the poses of the running robot; without a master, of --model", False
    )
    save: str | None = option("save the current pose", None, str, metavar="NAME")
    seconds: float = option(
        "duration of a smooth motion in simulated time [s]; 0: set the joints at once",
        0.0,
        within(0.0, 3600.0),
    )
    anchor: str | None = options.anchor()
    namespace: str = options.namespace()
    file: Path | None = option("file of your own poses", None, Path, shown=USER_FILE)
    model: str | None = option(
        f"with --list: its robot: {options.MODEL}",
        None,
        str,
        shown="the one that runs, or the default robot",
    )
    force: bool = option("with --save: replace a pose of that name", False)
    about: str = option("with --save: description of the pose", "")

    def __post_init__(self) -> None:
        """Check combinations of options.

        Raises:
            InvalidValueError: If options contradict each other.
        """
        given = [self.name is not None, self.list, self.save is not None]
        if sum(given) != 1:
            raise InvalidValueError("give one of NAME, --list and --save NAME")
        if (self.force or self.about) and self.save is None:
            raise InvalidValueError("--force and --about need --save")
        if self.anchor is not None and self.name is None:
            raise InvalidValueError("--anchor needs NAME")
        if self.model and not self.list:
            raise InvalidValueError("--model needs --list")
        if self.save == ZERO:
            raise InvalidValueError(f"{ZERO} cannot be saved: it is a built-in pose")


def parsed() -> PoseOptions:
    """Parse the command line; exit with a message if it is wrong."""
    return parse(PoseOptions, "pose", own_arguments())
