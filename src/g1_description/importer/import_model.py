"""The command import_model, which copies a robot and its meshes to a folder."""

from __future__ import annotations

import argparse
import math
import os
import shutil
import signal
import sys
import tempfile
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from g1_description.command_line import argument, exit_with_error, option, parse, within
from g1_description.errors import DescriptionError, G1DescriptionError
from g1_description.files.find import named_path, with_robots
from g1_description.importer.importing import Import, mesh_prefix
from g1_description.importer.meshes import (
    TOLERANCE,
    Options,
    millimetres,
)
from g1_description.importer.robot import ImportedRobot, first_profile, open_robot
from g1_description.interrupts import ENDING_SIGNALS
from g1_description.robot.load import ModelText, read_model
from g1_description.robot.profile import FILE, user_folder


class Folder:
    """An output folder, which is written to a temporary place until it is complete.

    Args:
        target: The folder; it may exist.
        replace: Whether existing files may be replaced.
        sources: Files that must not be replaced.
    """

    def __init__(self, target: Path, replace: bool, sources: Iterable[Path]) -> None:
        self.target = Path(os.path.abspath(target))
        self._replace = replace
        self._aside = Path()
        self._written: list[str] = []
        self._sources = {os.path.realpath(source) for source in sources}

    def check(self, names: Iterable[str]) -> None:
        """Check that files can be written.

        Raises:
            DescriptionError: If a path is blocked or exists.
        """
        if self.target.exists() and not self.target.is_dir():
            raise DescriptionError(
                f"Cannot write to {self.target}: it is not a folder."
            )
        for name in names:
            path = self.target / name
            blocks = [p for p in path.parents if p.exists() and not p.is_dir()]
            if blocks or path.is_dir():
                raise DescriptionError(
                    f"Cannot write {path}: {(blocks or [path])[0]} is in the way."
                )
            if os.path.lexists(path) and not self._replace:
                raise DescriptionError(
                    f"{path} already exists; use --force to replace it."
                )
            if os.path.realpath(path) in self._sources:
                raise DescriptionError(
                    f"Refusing to overwrite {path}, which is one of the imported "
                    "files; choose another folder."
                )

    def write(self, name: str, data: bytes) -> None:
        """Write a file to the temporary folder.

        Raises:
            DescriptionError: If its path is outside of the folder.
        """
        if ".." in Path(name).parts:
            raise DescriptionError(f"{name} is outside of {self.target}.")
        path = self._aside / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(data)
        self._written.append(name)

    @contextmanager
    def completed(self) -> Iterator[None]:
        """Move all files to the target on success; on errors, discard them.

        Raises:
            DescriptionError: If a path was blocked meanwhile.
        """
        above = next(p for p in self.target.parents if p.is_dir())
        self._aside = Path(tempfile.mkdtemp(prefix=".import_model-", dir=above))
        try:
            yield
            with undisturbed():
                self._put_in_place()
        finally:
            with undisturbed():
                shutil.rmtree(self._aside, ignore_errors=True)

    def _put_in_place(self) -> None:
        """Move the files to the target, in one step if it does not exist."""
        self.check(self._written)
        if not self.target.exists():
            self.target.parent.mkdir(parents=True, exist_ok=True)
            mask = os.umask(0)
            os.umask(mask)
            self._aside.chmod(0o777 & ~mask)
            self._aside.rename(self.target)
            return
        for name in self._written:
            path = self.target / name
            path.parent.mkdir(parents=True, exist_ok=True)
            (self._aside / name).replace(path)


@contextmanager
def undisturbed() -> Iterator[None]:
    """Ignore signals during a few renames."""
    former = {n: signal.signal(n, signal.SIG_IGN) for n in ENDING_SIGNALS}
    try:
        yield
    finally:
        for number, handler in former.items():
            signal.signal(number, handler)


def report(imported: Import, where: str) -> str:
    """Write the report, in Markdown.

    Args:
        imported: The import.
        where: A message on how the URDF names its meshes.
    """
    lines = ["# Import report", "", where, ""]
    for robot in imported.robots:
        source = f"From `{robot.source}`: {_figures(robot)}."
        lines += [f"## {os.path.basename(robot.name)}", "", source, ""]
        for title, texts in (("Changed", robot.changes), ("To check", robot.findings)):
            if texts:
                lines += [f"### {title}", "", *(f"- {text}" for text in texts), ""]
    if imported.faults:
        lines += ["## Skipped", "", *(f"- {fault}" for fault in imported.faults), ""]
    if imported.files:
        header = "| file | from | triangles | |"
        lines += ["## Meshes", "", header, "| --- | --- | ---: | --- |"]
    for name, file in sorted(imported.files.items()):
        count = "" if file.triangles is None else str(file.triangles)
        notes = "; ".join((*file.changes, *file.findings))
        lines.append(f"| {name} | {file.source} | {count} | {notes} |")
    return "\n".join(lines).rstrip() + "\n"


def summary(imported: Import) -> str:
    """Write the summary that the terminal shows."""
    lines = []
    for robot in imported.robots:
        lines.append(
            f"{os.path.basename(robot.name)} from {robot.source}: {_figures(robot)}"
        )
        lines += [f"  {text}" for text in (*robot.changes, *robot.findings)]
    files = imported.files.values()
    changed = sum(bool(file.changes) for file in files)
    lines.append(f"{len(files)} mesh files, {changed} changed")
    moved = {file.moved: file.name for file in files if file.moved is not None}
    if moved:
        most = max(moved)
        lines.append(
            f"Decimation moved no mesh by more than {millimetres(most)} "
            f"({moved[most]})."
        )
    lines += [f"  {file.name} {text}." for file in files for text in file.findings]
    lines += [f"Skipped: {fault}" for fault in imported.faults]
    return "\n".join(lines)


def _figures(robot: ImportedRobot) -> str:
    """Count parts of a robot."""
    found = robot.description
    meshes = sum(ref.is_mesh for ref in robot.references)
    mass = "" if found.mass is None else f" {found.mass:.6g} kg,"
    return (
        f"robot {found.name}, {len(found.links)} links, {len(found.joints)} joints "
        f"({len(found.movable_joints)} movable),{mass} meshes in {meshes} places"
    )


REPORT = "report.md"


def _folder(text: str) -> Path:
    """Parse the name of a folder; empty would mean the working directory."""
    if text:
        return Path(text)
    raise argparse.ArgumentTypeError("must not be empty")


@dataclass(frozen=True)
class ImportOptions:
    """Copy a robot with the meshes it uses into a folder.

    RViz, Gazebo and the simulator can read the copy. Without --out, the robot is only
    checked.
    """

    model: str = argument(
        "URDF or xacro file, as for model:= of the launch files, or a folder, which is "
        "searched for .urdf files with its subfolders; or a profile",
        str,
        metavar="MODEL",
    )
    out: Path | None = option("output folder", None, _folder, metavar="FOLDER")
    force: bool = option(
        "replace existing files; other files in the folder are kept", False
    )
    decimate: int | None = option(
        "reduce each mesh to N triangles, or as few as --tolerance allows",
        None,
        within(4, math.inf, int),
        metavar="N",
    )
    tolerance: float = option(
        "largest distance that --decimate may move a surface, measured in both "
        "directions [m]",
        TOLERANCE,
        within(0.0),
        metavar="METRES",
    )
    convex_collisions: bool = option(
        "replace STL and OBJ collision meshes by their convex hulls", False
    )
    keep_missing: bool = option("keep references to missing meshes in the URDF", False)


def read_models(model: str) -> tuple[list[ModelText], list[str]]:
    """Read a file, or all robots in a folder and below it, except hidden ones.

    Returns:
        The robots, and a message for each file of a folder that is not a robot.

    Raises:
        DescriptionError: If there is no valid robot.
    """
    folder = named_path(model)
    if not folder.is_dir() or (folder / FILE).is_file():
        return [_read(model)], []
    names: list[str] = []
    for place, folders, files in os.walk(str(folder)):
        folders[:] = sorted(name for name in folders if not name.startswith("."))
        names += [os.path.join(place, n) for n in sorted(files) if n.endswith(".urdf")]
    if not names:
        more = with_robots(folder)
        raise DescriptionError(
            f"The folder {folder} and its subfolders have no .urdf file{more}."
        )
    models, faults = [], []
    for name in names:
        try:
            models.append(_read(name))
        except DescriptionError as error:
            faults.append(str(error))
    if not models:
        more = f" ({len(faults)} files, but no robot)" if len(faults) > 1 else ""
        raise DescriptionError(f"{faults[0]}{more}")
    return models, faults


def _read(name: str) -> ModelText:
    """Read a robot; the error names it."""
    try:
        return read_model(name)
    except G1DescriptionError as error:
        raise DescriptionError(f"Cannot use the model {name}: {error}") from error


def import_into(
    folder: Folder, robots: list[ImportedRobot], faults: list[str], options: Options
) -> str:
    """Write the folder; return the summary.

    Raises:
        DescriptionError: If files already exist.
        OSError: If it cannot be written.
    """
    folder.check([REPORT, *(robot.name for robot in robots)])
    profile: dict[str, bytes] = {}
    use = "Several robots have no profile: import one at a time to get it."
    if len(robots) == 1:
        files, target = first_profile(robots[0]), folder.target
        profile = {n: t for n, t in files.items() if not os.path.lexists(target / n)}
        use = (
            f"The folder is a profile to complete in {FILE}: robot:={target}, or its "
            f"name if it is in {user_folder()}."
        )
    prefix, where = mesh_prefix(folder.target)
    imported = Import(robots, options, prefix, folder.write, faults)
    with folder.completed():
        imported.run()
        for name, content in profile.items():
            folder.write(name, content)
        folder.write(REPORT, report(imported, where).encode("utf-8"))
    return f"{summary(imported)}\n{where}\n{use}\nWritten: {folder.target}"


def run(arguments: list[str]) -> str:
    """Run a command line; return its output.

    Raises:
        G1DescriptionError: If it fails; nothing was changed.
        OSError: If the folder cannot be written.
    """
    args = parse(ImportOptions, "import_model", arguments)
    models, faults = read_models(args.model)
    named: dict[str, ImportedRobot] = {}
    for model in models:
        robot = open_robot(model)
        while robot.name in named:
            robot.number += 1
        named[robot.name] = robot
    robots = [*named.values()]
    options = Options(
        args.decimate, args.tolerance, args.convex_collisions, args.keep_missing
    )
    if args.out is None:
        imported = Import(robots, options, "../meshes", lambda name, data: None, faults)
        imported.run()
        return f"{summary(imported)}\nOnly checked: use --out to write the result."
    meshes = (ref.path for robot in robots for ref in robot.references if ref.path)
    sources = [*(robot.source for robot in robots), *meshes]
    return import_into(Folder(args.out, args.force, sources), robots, faults, options)


def main() -> None:
    """Run the command, or exit with a message."""
    for number in ENDING_SIGNALS:  # the temporary folder is removed
        if signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, signal.default_int_handler)
    try:
        print(run(sys.argv[1:]))
    except (G1DescriptionError, OSError) as error:
        exit_with_error("import_model", error)
