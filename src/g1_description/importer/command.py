"""The command import_model: a robot from elsewhere becomes a clean folder."""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path

from ..core.command_line import OneSentenceParser
from ..core.errors import DescriptionError, G1DescriptionError
from ..core.model_path import named_path, with_robots
from ..core.model_text import ModelText, read_model
from .folder import Folder
from .importing import Import
from .meshes import Wishes
from .report import report, summary
from .robot import Robot, open_robot
from .uris import mesh_prefix

REPORT = "report.md"

PERIOD = 2.0
"""Time between two lines of progress, in [s]."""


def parser() -> OneSentenceParser:
    """Make a parser of the command line."""
    made = OneSentenceParser(
        prog="import_model",
        description="Copy a robot with the meshes it uses into a folder, so that RViz, "
        "Gazebo and the stand-in read it. Without --out it is only checked.",
    )
    made.add_argument(
        "model",
        help="URDF or xacro file, as for model:= of the launch files; or a folder: "
        "every .urdf in it",
    )
    made.add_argument("--out", type=_folder, metavar="FOLDER", help="where to write")
    made.add_argument("--force", action="store_true", help="replace what is in the way")
    made.add_argument(
        "--decimate", type=_count, metavar="N", help="at most N triangles per mesh"
    )
    made.add_argument(
        "--convex-collisions",
        action="store_true",
        help="convex hulls for meshes of collisions",
    )
    made.add_argument(
        "--keep-missing",
        action="store_true",
        help="leave meshes that are missing in the URDF",
    )
    return made


def _count(text: str) -> int:
    """Read how many triangles a mesh may have; a body has at least four."""
    if text.isdecimal() and int(text) >= 4:
        return int(text)
    raise argparse.ArgumentTypeError(f"'{text}' is no whole number from 4 on")


def _folder(text: str) -> Path:
    """Read the name of a folder; an empty one would be the working directory."""
    if text:
        return Path(text)
    raise argparse.ArgumentTypeError("'' is no folder")


def read_models(asked: str) -> list[ModelText]:
    """Read a file, or all robots in a folder.

    Raises:
        DescriptionError: If one of them is none; the sentence names it.
    """
    names = [asked]
    folder = named_path(asked)
    if folder.is_dir():
        names = [str(path) for path in sorted(folder.glob("*.urdf"))]
        if not names:
            more = with_robots(folder)
            raise DescriptionError(f"There is no .urdf in the folder {folder}{more}.")
    models = []
    for name in names:
        try:
            models.append(read_model(name))
        except G1DescriptionError as error:
            raise DescriptionError(
                f"The model {name} cannot be used: {error}"
            ) from error
    return models


class Progress:
    """Tells on stderr how far it is, when that takes long."""

    def __init__(self) -> None:
        """Begin to wait."""
        self._told = time.monotonic()

    def __call__(self, done: int, total: int) -> None:
        """Hear how many are done, and tell it now and then."""
        if time.monotonic() - self._told > PERIOD:
            self._told = time.monotonic()
            print(f"import_model: {done} of {total} meshes", file=sys.stderr)


def check_only(robots: list[Robot], wishes: Wishes) -> str:
    """Check robots and write nothing; give the summary of what would be done."""
    imported = Import(robots, wishes, "../meshes", lambda name, data: None)
    imported.run(Progress())
    return f"{summary(imported)}\nOnly checked: without --out nothing is written."


def import_into(folder: Folder, robots: list[Robot], wishes: Wishes) -> str:
    """Write the folder; give the summary.

    Raises:
        DescriptionError: If something is in the way.
        OSError: If it cannot be written.
    """
    meshes = (ref.path for robot in robots for ref in robot.references if ref.path)
    folder.protect([*(robot.source for robot in robots), *meshes])
    folder.check([REPORT, *(robot.name for robot in robots)])
    prefix, where = mesh_prefix(folder.target)
    imported = Import(robots, wishes, prefix, folder.write)
    with folder.completed():
        imported.run(Progress())
        folder.write(REPORT, report(imported, where).encode("utf-8"))
    return f"{summary(imported)}\n{where}\nWritten: {folder.target}"


def run(arguments: list[str]) -> str:
    """Do what a command line asks; give what to print.

    Raises:
        G1DescriptionError: If it cannot be done; nothing was changed.
        OSError: If the folder cannot be written.
    """
    asked = parser().parse_args(arguments)
    robots = [open_robot(model) for model in read_models(asked.model)]
    wishes = Wishes(asked.decimate, asked.convex_collisions, asked.keep_missing)
    if asked.out is None:
        return check_only(robots, wishes)
    return import_into(Folder(asked.out, asked.force), robots, wishes)
