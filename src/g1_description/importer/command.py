"""The command import_model: a robot from elsewhere becomes a clean folder."""

from __future__ import annotations

import argparse
import math
import os
import sys
import time
from pathlib import Path

from g1_description.core.cli import OneSentenceParser
from g1_description.core.errors import DescriptionError, G1DescriptionError
from g1_description.core.files.find import named_path, with_robots
from g1_description.core.files.load import ModelText, read_model
from g1_description.importer.meshes.meshes import TOLERANCE, Options

from .folder import Folder
from .importing import Import
from .naming import mesh_prefix
from .report import report, summary
from .robot import Robot, open_robot

REPORT = "report.md"

PROGRESS_PERIOD = 2.0
"""Time between two lines of progress, in [s]."""


def parser() -> OneSentenceParser:
    """Make a parser of the command line."""
    made = OneSentenceParser(
        prog="import_model",
        description="Copy a robot with the meshes it uses into a folder, so that RViz, "
        "Gazebo and the stand-in can read it. Without --out, only check the robot.",
    )
    made.add_argument(
        "model",
        help="URDF or xacro file, as for model:= of the launch files, or a folder, "
        "which is searched for .urdf files with its subfolders",
    )
    made.add_argument("--out", type=_folder, metavar="FOLDER", help="output folder")
    made.add_argument("--force", action="store_true", help="replace existing files")
    made.add_argument(
        "--decimate",
        type=_count,
        metavar="N",
        help="reduce each mesh to N triangles, or as few as --tolerance allows",
    )
    made.add_argument(
        "--tolerance",
        type=_distance,
        default=TOLERANCE,
        metavar="METRES",
        help="largest distance that --decimate may move a surface, measured in both "
        f"directions; default: {TOLERANCE}",
    )
    made.add_argument(
        "--convex-collisions",
        action="store_true",
        help="replace collision meshes by their convex hulls",
    )
    made.add_argument(
        "--keep-missing",
        action="store_true",
        help="keep references to missing meshes in the URDF",
    )
    return made


def _count(text: str) -> int:
    """Read a number of triangles; a closed surface has at least four."""
    if text.isdecimal() and int(text) >= 4:
        return int(text)
    raise argparse.ArgumentTypeError(f"'{text}' is not a whole number of at least 4")


def _distance(text: str) -> float:
    """Read how far a surface may move."""
    try:
        distance = float(text)
    except ValueError:
        distance = math.nan
    if 0.0 <= distance < math.inf:
        return distance
    raise argparse.ArgumentTypeError(f"'{text}' is not a length in metres")


def _folder(text: str) -> Path:
    """Read the name of a folder; an empty one would be the working directory."""
    if text:
        return Path(text)
    raise argparse.ArgumentTypeError("'' is not a folder")


def read_models(model: str) -> tuple[list[ModelText], list[str]]:
    """Read a file, or all robots in a folder and below it.

    Returns:
        The robots, and a message for each file of a folder that is not a robot.

    Raises:
        DescriptionError: If there is no robot.
    """
    folder = named_path(model)
    if not folder.is_dir():
        return [_read(model)], []
    names = _urdf_files(folder)
    if not names:
        more = with_robots(folder)
        raise DescriptionError(
            f"There is no .urdf in the folder {folder} or below it{more}."
        )
    models, faults = [], []
    for name in names:
        try:
            models.append(_read(name))
        except DescriptionError as error:
            faults.append(str(error))
    if not models:
        more = (
            f" ({len(faults)} files, none of which is a robot)"
            if len(faults) > 1
            else ""
        )
        raise DescriptionError(f"{faults[0]}{more}")
    return models, faults


def _urdf_files(folder: Path) -> list[str]:
    """List the .urdf files in a folder and below it, but for hidden folders."""
    found = []
    for place, folders, names in os.walk(str(folder)):
        folders[:] = sorted(name for name in folders if not name.startswith("."))
        found += [os.path.join(place, n) for n in sorted(names) if n.endswith(".urdf")]
    return found


def _read(name: str) -> ModelText:
    """Read a robot.

    Raises:
        DescriptionError: If it is not one; the message names it.
    """
    try:
        return read_model(name)
    except G1DescriptionError as error:
        raise DescriptionError(f"The model {name} cannot be used: {error}") from error


def _open(models: list[ModelText]) -> list[Robot]:
    """Open robots; those with equal file names are numbered."""
    robots: dict[str, Robot] = {}
    for model in models:
        robot = open_robot(model)
        while robot.name in robots:
            robot.number += 1
        robots[robot.name] = robot
    return list(robots.values())


class Progress:
    """Reports progress on stderr when the import takes long."""

    def __init__(self) -> None:
        """Start the first period."""
        self._reported = time.monotonic()

    def __call__(self, done: int, total: int) -> None:
        """Print how many are done, every ``PROGRESS_PERIOD``."""
        if time.monotonic() - self._reported > PROGRESS_PERIOD:
            self._reported = time.monotonic()
            print(f"import_model: {done} of {total} meshes", file=sys.stderr)


def check_only(robots: list[Robot], faults: list[str], options: Options) -> str:
    """Check robots and write nothing; return the summary of what would be done."""
    imported = Import(robots, options, "../meshes", lambda name, data: None, faults)
    imported.run(Progress())
    return f"{summary(imported)}\nOnly checked: nothing is written without --out."


def import_into(
    folder: Folder, robots: list[Robot], faults: list[str], options: Options
) -> str:
    """Write the folder; return the summary.

    Raises:
        DescriptionError: If something is in the way.
        OSError: If it cannot be written.
    """
    meshes = (ref.path for robot in robots for ref in robot.references if ref.path)
    folder.protect([*(robot.source for robot in robots), *meshes])
    folder.check([REPORT, *(robot.name for robot in robots)])
    prefix, where = mesh_prefix(folder.target)
    imported = Import(robots, options, prefix, folder.write, faults)
    with folder.completed():
        imported.run(Progress())
        folder.write(REPORT, report(imported, where).encode("utf-8"))
    return f"{summary(imported)}\n{where}\nWritten: {folder.target}"


def run(arguments: list[str]) -> str:
    """Run a command line; return what to print.

    Raises:
        G1DescriptionError: If it fails; nothing was changed.
        OSError: If the folder cannot be written.
    """
    args = parser().parse_args(arguments)
    models, faults = read_models(args.model)
    robots = _open(models)
    options = Options(
        args.decimate, args.tolerance, args.convex_collisions, args.keep_missing
    )
    if args.out is None:
        return check_only(robots, faults, options)
    return import_into(Folder(args.out, args.force), robots, faults, options)
