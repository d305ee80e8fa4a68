"""Import robots: write their URDFs and meshes, and keep what was changed."""

from __future__ import annotations

import os
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Callable

from g1_description.core.errors import DescriptionError
from g1_description.importer.meshes.meshes import (
    Mesh,
    Options,
    Reader,
    make_mesh,
    read_bytes,
)
from g1_description.importer.meshes.side_files import side_files_of

from .masses import impossible_inertias, massless_links, write_zero_masses
from .naming import FileNames
from .robot import Reference, Robot

Write = Callable[[str, bytes], None]
"""Takes the name of a file in the result, and its content."""

Progress = Callable[[int, int], None]
"""Takes the number of meshes that are done, and of all."""


@dataclass
class MeshFile:
    """A file of the result, for the report."""

    name: str
    source: Path
    triangles: int | None = None
    changes: tuple[str, ...] = ()
    findings: tuple[str, ...] = ()
    moved: float | None = None
    """How far decimation moved its surface, in [m]."""


@dataclass
class Import:
    """The import of robots into one folder."""

    robots: list[Robot]
    options: Options
    prefix: str
    """What a mesh's name in the URDF begins with."""

    write: Write
    faults: list[str] = field(default_factory=list)
    """A message for each file that is not a robot and was skipped."""

    files: dict[str, MeshFile] = field(default_factory=dict)
    """Meshes of the result by their names in it."""

    _names: FileNames = field(init=False)
    _reader: Reader = field(init=False)
    _side_files: dict[Path, tuple[dict[str, Path], list[str]]] = field(init=False)
    _scales: dict[Path, float] = field(default_factory=dict)
    """Largest scale of each mesh."""

    _made: dict[tuple[Path, bool], str | DescriptionError] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Find all files of the result."""
        for ref in self._references():
            if ref.path:
                self._scales[ref.path] = max(self._scales.get(ref.path, 0.0), ref.scale)
        paths = dict.fromkeys(ref.path for ref in self._references() if ref.path)
        self._side_files = {path: side_files_of(path) for path in paths}
        beside = (
            Path(os.path.normpath(path.parent / name))
            for path, (found, _) in self._side_files.items()
            for name in found
        )
        self._names = FileNames([*paths, *beside])
        meshes = (ref.path for ref in self._references() if ref.is_mesh and ref.path)
        self._reader = Reader(dict.fromkeys(meshes))

    def _references(self) -> Iterable[Reference]:
        """Return the references of all robots."""
        return (ref for robot in self.robots for ref in robot.references)

    def run(self, progress: Progress) -> None:
        """Import all robots.

        Raises:
            OSError: If something cannot be written.
        """
        total = sum(len(robot.references) for robot in self.robots)
        done = 0
        for robot in self.robots:
            for reference in robot.references:
                self._settle(robot, reference)
                done += 1
                progress(done, total)
            _settle_masses(robot)
            _settle_mujoco(robot)
            self.write(robot.name, robot.text())

    def _settle(self, robot: Robot, reference: Reference) -> None:
        """Set the new name of a mesh or texture, or remove it from the URDF."""
        if not reference.name:
            kind = reference.element.tag
            robot.findings.append(
                f"The {kind} of {reference.owner} names no file; removed."
            )
            reference.remove()
            return
        if not reference.is_local:
            robot.findings.append(
                f"{reference.name} ({reference.owner}) is not a local file."
            )
            return
        why: object = "does not exist"
        if reference.path is not None:
            made = self._file(reference.path, reference)
            if isinstance(made, str):
                reference.element.set("filename", f"{self.prefix}/{made}")
                return
            why = f"cannot be read: {made}"
        fate = "kept in the URDF" if self.options.keep_missing else "removed"
        robot.findings.append(f"{reference.name} ({reference.owner}) {why}; {fate}.")
        if not self.options.keep_missing:
            reference.remove()

    def _file(self, path: Path, reference: Reference) -> str | DescriptionError:
        """Return the name of a file, which the first call writes."""
        key = path, reference.is_collision and self.options.convex_collisions
        if key not in self._made:
            try:
                mesh = self._make(path, reference)
            except DescriptionError as error:
                self._made[key] = error
                return error
            name = self._names.of(path, mesh.name)
            self._write_mesh(path, name, mesh)
            self._made[key] = name
        return self._made[key]

    def _make(self, path: Path, reference: Reference) -> Mesh:
        """Make a mesh, or copy a texture."""
        if not reference.is_mesh:
            return Mesh(read_bytes(path), "")
        scale = self._scales[path]
        return make_mesh(
            path, self._reader, reference.is_collision, scale, self.options
        )

    def _write_mesh(self, path: Path, name: str, mesh: Mesh) -> None:
        """Write a mesh with its side files."""
        found, absent = ({}, []) if mesh.name else self._side_files[path]
        gone = tuple(f"names {name}, which does not exist" for name in absent)
        record = mesh.triangles, mesh.changes, mesh.findings + gone, mesh.moved
        self.files[name] = MeshFile(name, path, *record)
        self.write(f"meshes/{name}", mesh.data)
        for relative, file in found.items():
            place = os.path.normpath(os.path.join(os.path.dirname(name), relative))
            self.files[place] = MeshFile(place, file)
            self.write(f"meshes/{place}", file.read_bytes())


def _settle_masses(robot: Robot) -> None:
    """Write known masses explicitly, and report unknown ones."""
    held, unknown = massless_links(robot.description)
    if held:
        write_zero_masses(robot.root, held)
        robot.changes.append(
            f"Massless links fixed to a body with mass got an explicit mass of 0: "
            f"{', '.join(held)}."
        )
    robot.findings += [
        f"Link {name} has no mass and is not fixed to a link with mass: Gazebo ignores "
        "it and all links below it."
        for name in unknown
    ]
    robot.findings += impossible_inertias(robot.description)


def _settle_mujoco(robot: Robot) -> None:
    """Update the folder of meshes in MuJoCo's extension, if there is one."""
    for compiler in robot.root.iterfind("mujoco/compiler[@meshdir]"):
        former = compiler.get("meshdir")
        if former != "../meshes":
            robot.changes.append(f"MuJoCo's meshdir was {former} and is ../meshes now.")
            compiler.set("meshdir", "../meshes")
