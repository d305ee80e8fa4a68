"""The import itself: robots in, a folder and a report out."""

from __future__ import annotations

import os
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Callable

from g1_description.core.errors import DescriptionError
from g1_description.importer.meshes.companions import companions_of
from g1_description.importer.meshes.meshes import (
    Mesh,
    Reader,
    Wishes,
    make_mesh,
    read_bytes,
)

from .masses import impossible_inertias, massless_links, write_zero_masses
from .places import Places
from .robot import Reference, Robot

Write = Callable[[str, bytes], None]
"""Takes the name of a file in the result, and its content."""

Progress = Callable[[int, int], None]
"""Is told how many meshes are done, and of how many."""


@dataclass
class MeshFile:
    """What became of a mesh, for the report."""

    name: str
    source: Path
    triangles: int | None = None
    changes: tuple[str, ...] = ()
    findings: tuple[str, ...] = ()
    moved: float | None = None
    """How far fewer triangles moved it, in [m]."""


@dataclass
class Import:
    """Robots on their way into one folder."""

    robots: list[Robot]
    wishes: Wishes
    prefix: str
    """What a mesh's name in the URDF begins with."""

    write: Write
    faults: list[str] = field(default_factory=list)
    """A sentence for each file that is no robot and was left out."""

    files: dict[str, MeshFile] = field(default_factory=dict)
    """Meshes of the result by their names in it."""

    _places: Places = field(init=False)
    _reader: Reader = field(init=False)
    _companions: dict[Path, tuple[dict[str, Path], list[str]]] = field(init=False)
    _scales: dict[Path, float] = field(default_factory=dict)
    """By how much the robots magnify a mesh, at most."""

    _made: dict[tuple[Path, bool], str | DescriptionError] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Find all files that there will be."""
        for ref in self._references():
            if ref.path:
                self._scales[ref.path] = max(self._scales.get(ref.path, 0.0), ref.scale)
        paths = dict.fromkeys(ref.path for ref in self._references() if ref.path)
        self._companions = {path: companions_of(path) for path in paths}
        beside = (
            Path(os.path.normpath(path.parent / name))
            for path, (found, _) in self._companions.items()
            for name in found
        )
        self._places = Places([*paths, *beside])
        meshes = (ref.path for ref in self._references() if ref.is_mesh and ref.path)
        self._reader = Reader(dict.fromkeys(meshes))

    def _references(self) -> Iterable[Reference]:
        """Give the files that all robots name."""
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
        """Give a mesh or texture its place, or take it out of the URDF."""
        if not reference.name:
            kind = reference.element.tag
            told = f"The {kind} of {reference.owner} names no file; taken out."
            robot.findings.append(told)
            reference.remove()
            return
        if not reference.is_local:
            robot.findings.append(f"{reference.name} ({reference.owner}) is elsewhere.")
            return
        why: object = "does not exist"
        if reference.path is not None:
            made = self._file(reference.path, reference)
            if isinstance(made, str):
                reference.element.set("filename", f"{self.prefix}/{made}")
                return
            why = f"cannot be read: {made}"
        fate = "the URDF still names it" if self.wishes.keep_missing else "taken out"
        robot.findings.append(f"{reference.name} ({reference.owner}) {why}; {fate}.")
        if not self.wishes.keep_missing:
            reference.remove()

    def _file(self, path: Path, reference: Reference) -> str | DescriptionError:
        """Give the place of a file, which is written when it is first asked for."""
        key = path, reference.is_collision and self.wishes.convex_collisions
        if key not in self._made:
            try:
                mesh = self._make(path, reference)
            except DescriptionError as error:
                self._made[key] = error
                return error
            name = self._places.place(path, mesh.name)
            self._write_mesh(path, name, mesh)
            self._made[key] = name
        return self._made[key]

    def _make(self, path: Path, reference: Reference) -> Mesh:
        """Read a mesh, or a texture as it is."""
        if not reference.is_mesh:
            return Mesh(read_bytes(path), "")
        scale = self._scales[path]
        return make_mesh(path, self._reader, reference.is_collision, scale, self.wishes)

    def _write_mesh(self, path: Path, name: str, mesh: Mesh) -> None:
        """Write a mesh with what it names."""
        found, absent = ({}, []) if mesh.name else self._companions[path]
        gone = tuple(f"names {name}, which does not exist" for name in absent)
        told = mesh.triangles, mesh.changes, mesh.findings + gone, mesh.moved
        self.files[name] = MeshFile(name, path, *told)
        self.write(f"meshes/{name}", mesh.data)
        for relative, companion in found.items():
            place = os.path.normpath(os.path.join(os.path.dirname(name), relative))
            self.files[place] = MeshFile(place, companion)
            self.write(f"meshes/{place}", companion.read_bytes())


def _settle_masses(robot: Robot) -> None:
    """Make masses explicit that are known, and name those that are not."""
    held, unknown = massless_links(robot.description)
    if held:
        write_zero_masses(robot.root, held)
        robot.changes.append(
            f"Mass 0 for links without <inertial> that are fixed to others: "
            f"{', '.join(held)}."
        )
    robot.findings += [
        f"Link {name} has no <inertial> with a mass and is fixed to no mass: Gazebo "
        "leaves it out, with all below it."
        for name in unknown
    ]
    robot.findings += impossible_inertias(robot.description)


def _settle_mujoco(robot: Robot) -> None:
    """Tell MuJoCo where the meshes are now, if it was told before."""
    for compiler in robot.root.iterfind("mujoco/compiler[@meshdir]"):
        former = compiler.get("meshdir")
        if former != "../meshes":
            robot.changes.append(f"MuJoCo's meshdir is ../meshes, was {former}.")
            compiler.set("meshdir", "../meshes")
