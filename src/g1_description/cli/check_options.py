"""The command line of check."""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from pathlib import Path

from g1_description.checks.rules import RULES
from g1_description.cli import options
from g1_description.command_line import argument, option, within
from g1_description.errors import InvalidValueError
from g1_description.text import listed, similar_first

MISUSE = 2
"""Exit code where the command line is wrong, or something cannot be checked."""

STDOUT = "-"

ENDINGS = {"json": ".json", "csv": ".csv", "html": ".html"}
"""What names of reports end in."""


def checks(text: str) -> tuple[str, ...]:
    """Read names of checks."""
    known = [rule.name for rule in RULES]
    names = tuple(name.strip() for name in text.split(","))
    for name in names:
        if name not in known:
            near = ", ".join(similar_first(name, known))
            raise argparse.ArgumentTypeError(f"unknown check '{name}'; known: {near}")
    return names


@dataclass(frozen=True)
class CheckOptions:
    """Check motions in files.

    Limits, jumps, self-collisions, the floor, balance, and with --physics what motors
    make of them. The exit code is 0 if nothing failed, 1 if a motion failed, 2 if
    something could not be checked.
    """

    files: list[Path] = argument(
        "a motion (CSV, npz, pickle, bag, YAML of a trajectory), or a folder with "
        "motions below it",
        Path,
        nargs="+",
        metavar="FILE",
    )
    model: str | None = options.model()
    fps: float | None = options.fps()
    topic: str | None = options.topic()
    thresholds: Path | None = options.thresholds()
    only: tuple[str, ...] = option(
        "make only these checks, such as position,self_collision",
        (),
        checks,
        metavar="CHECK,...",
    )
    fixed_base: bool = option(
        "the base is fixed: efforts are checked, the floor is not", False
    )
    no_visual_hulls: bool = option(
        "do not substitute hulls of visual shapes for missing collision shapes", False
    )
    collisions: Path | None = option(
        "file of the pairs of links that may touch by design, as collision_pairs "
        "writes it",
        None,
        Path,
        metavar="YAML",
        see="[allowed pairs](checks.md#allowed-pairs)",
    )
    physics: bool = option(
        "also simulate the motions with motors, about as fast as real time",
        False,
        see="[physics](checks.md#what-physics-says)",
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
        "write a page with all findings and plots", None, Path, metavar="FILE"
    )
    quiet: bool = option("print only the last line, with the counts", False)
    jobs: int = option(
        "number of worker processes", 1, within(1, 256, int), metavar="N"
    )
    dask: str | None = option(
        "check on the workers of this Dask scheduler", None, str, metavar="HOST:PORT"
    )

    def __post_init__(self) -> None:
        """Check what goes together.

        Raises:
            InvalidValueError: If options contradict each other.
        """
        if self.dask is not None and self.jobs > 1:
            raise InvalidValueError("--jobs and --dask cannot be combined")
        played = [rule.name for rule in RULES if rule.needs_physics]
        physics = [name for name in self.only if name in played]
        if physics and not self.physics:
            raise InvalidValueError(f"--only {listed(physics)} needs --physics")
        for name, ending in ENDINGS.items():
            file = getattr(self, name)
            if file not in (None, STDOUT) and Path(file).suffix.lower() != ending:
                raise InvalidValueError(f"--{name} {file} does not end in {ending}")
        if self.json == self.csv == STDOUT:
            raise InvalidValueError("--json and --csv cannot both be on stdout")
