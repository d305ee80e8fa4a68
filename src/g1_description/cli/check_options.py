"""Options of the command check, without what checks: help needs nothing else."""

from __future__ import annotations

import argparse
import re
from dataclasses import dataclass
from pathlib import Path

from g1_description.choices import ENGINES, MAX_PORT
from g1_description.cli import options
from g1_description.command_line import number, option, own_arguments, parse
from g1_description.errors import InvalidValueError
from g1_description.text import listed, similar_first

STDOUT = "-"

REPORTS = {"json": ".json", "csv": ".csv", "html": ".html", "write_selection": ".yaml"}
"""File extensions of reports."""


def scheduler(text: str) -> str:
    """Parse the address of a Dask scheduler."""
    match = re.fullmatch(r"((tcp|tls)://)?(\[[^\]]+\]|[^:/\s]+):(\d+)", text)
    if match and 0 < int(match[4]) <= MAX_PORT:
        return text
    raise argparse.ArgumentTypeError(
        f"must be HOST:PORT, such as localhost:8786 (got '{text}')"
    )


def checks(text: str) -> tuple[str, ...]:
    """Read names of checks."""
    from g1_description.checks.rules import RULES

    known = [rule.name for rule in RULES]
    names = tuple(name.strip() for name in text.split(","))
    for name in names:
        if name not in known:
            near = ", ".join(similar_first(name, known))
            raise argparse.ArgumentTypeError(
                f"unknown check '{name}'; known checks: {near}"
            )
    return names


@dataclass(frozen=True)
class CheckOptions:
    """Check motions in files.

    Checks limits, jumps, self-collisions, floor contact, balance, with --scene
    collisions with objects, and with --physics the tracking by motors. The exit code is
    0 if nothing failed, 1 if a motion failed, 2 if something could not be checked.
    """

    files: list[Path] = options.motions()
    model: str = options.model()
    fps: float | None = options.fps()
    topic: str | None = options.topic()
    order: str | None = options.order()
    input_joint_order: str | None = options.input_joint_order()
    format: str | None = options.file_format()
    every: bool = option(
        "check all motions of files that have several", False, names=("--all",)
    )
    thresholds: Path | None = options.thresholds()
    only: tuple[str, ...] = option(
        "make only these checks, such as position,self_collision",
        (),
        checks,
        metavar="CHECK,...",
    )
    scene: Path | None = options.scene()
    fixed_base: bool = option(
        "the base is fixed: efforts are checked, the floor is not", False
    )
    no_visual_hulls: bool = option(
        "do not substitute hulls of visual shapes for missing collision shapes", False
    )
    motors: Path | None = option(
        "with --physics: file of the motors",
        None,
        Path,
        metavar="YAML",
        shown="that of the robot's profile, or as in its URDF",
        see="[motors](motions.md#tracked-by-motors)",
    )
    scene: Path | None = options.scene()
    collisions: Path | None = options.collisions()
    selection: Path | None = options.selection()
    write_selection: Path | None = option(
        "exclude the motions that a rule of the thresholds excludes in this selection, "
        "which need not exist",
        None,
        Path,
        metavar="YAML",
        see="[selections](many_motions.md#a-selection)",
    )
    physics: bool = option(
        "also simulate the motions with motors, several times as fast as real time",
        False,
        see="[physics](physics_check.md)",
    )
    engine: str | None = option(
        "with --physics: physics engine, bullet or mujoco",
        None,
        str,
        choices=ENGINES,
        shown="mujoco, if it is installed",
        see="[engines](launch.md#engines)",
    )
    json: str | None = option(
        "write a report with all findings; -: to stdout, instead of the tables",
        None,
        str,
        metavar="FILE",
    )
    csv: str | None = option(
        "write a table with a row per file; -: to stdout, instead of the tables",
        None,
        str,
        metavar="FILE",
    )
    plot: Path | None = option(
        "draw a .png for one motion, or a folder of them for several",
        None,
        Path,
        metavar="OUT",
    )
    html: Path | None = option(
        "write a page with the robot, causes and plots", None, Path, metavar="FILE"
    )
    against: Path | None = option(
        "compare with this reference, or with those of the same names in this folder",
        None,
        Path,
        metavar="REFERENCE",
        see="[executed motions](checks.md#executed-motions)",
    )
    shift: float | None = option(
        "time of the executed motion minus that of the reference in s, for --against",
        None,
        number,
        metavar="SECONDS",
        shown="found",
    )
    watch: bool = option(
        "check again whenever a motion changes, until Ctrl-C; faster than starting "
        "again",
        False,
    )
    quiet: bool = option("print only the last line, with the counts", False)
    jobs: int = options.jobs()
    dask: str | None = option(
        "check on the workers of this Dask scheduler",
        None,
        scheduler,
        metavar="HOST:PORT",
    )

    def __post_init__(self) -> None:
        """Check combinations of options.

        Raises:
            InvalidValueError: If options contradict each other.
        """
        if self.dask is not None and self.jobs > 1:
            raise InvalidValueError("--jobs and --dask cannot be combined")
        if self.only and not self.physics:
            self._check_only()
        for name, ending in REPORTS.items():
            file = getattr(self, name)
            if file not in (None, STDOUT) and Path(file).suffix.lower() != ending:
                flag = f"--{name.replace('_', '-')}"
                raise InvalidValueError(f"{flag} must end in {ending} (got {file})")
        needed = {"motors": "physics", "engine": "physics", "shift": "against"}
        for name, other in needed.items():
            if getattr(self, name) is not None and not getattr(self, other):
                raise InvalidValueError(f"--{name} needs --{other}")
        if self.watch and self.dask is not None:
            raise InvalidValueError("--watch and --dask cannot be combined")
        names = ("csv", "plot", "html", "write_selection", "dask", "only", "quiet")
        names += ("watch", "scene")
        unfit = [f"--{name.replace('_', '-')}" for name in names if getattr(self, name)]
        unfit += ["--jobs"] if self.jobs > 1 else []
        if self.against is not None and unfit:
            raise InvalidValueError(f"--against cannot be combined with {unfit[0]}")
        if self.json == self.csv == STDOUT:
            raise InvalidValueError("--json and --csv cannot both write to stdout")

    def _check_only(self) -> None:
        """Check that no check that was named needs a simulation."""
        from g1_description.checks.rules import RULES

        played = [rule.name for rule in RULES if rule.needs_physics]
        physics = [name for name in self.only if name in played]
        if physics:
            raise InvalidValueError(f"--only {listed(physics)} needs --physics")


def parsed() -> CheckOptions:
    """Parse the command line; exit with a message if it is wrong."""
    return parse(CheckOptions, "check", own_arguments())
