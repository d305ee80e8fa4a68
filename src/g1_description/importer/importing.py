"""Importing robots: their URDFs and meshes, with a record of changes."""

from __future__ import annotations

import os
import re
import sys
import time
from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Callable

from lxml import etree

from g1_description.errors import DescriptionError
from g1_description.files.model_files import find_folder
from g1_description.files.uris import FINDABLE, package_name, scheme_of
from g1_description.importer.meshes import (
    MeshFile,
    MeshReader,
    Options,
    make_mesh,
    read_bytes,
    side_files_of,
)
from g1_description.importer.robot import ImportedRobot, Reference
from g1_description.robot.assembly import rigid_frames
from g1_description.robot.description import Description
from g1_description.robot.lumping import fault_of


def massless_links(description: Description) -> tuple[list[str], list[str]]:
    """Find the links without a mass, except the root.

    Returns:
        Links without an inertial that are fixed to a link with mass, so their mass is
        zero; and those that are not, whose mass is unknown and which Gazebo ignores.
    """
    frames = rigid_frames(description, as_lumped=True)
    own = {link.name: link.inertial for link in description.links}
    bare = [name for name, found in own.items() if found is None or found.mass == 0.0]
    with_mass = {frames[name][0] for name in own if name not in bare}
    bare = [name for name in bare if name != description.root]
    held = [name for name in bare if frames[name][0] in with_mass]
    unknown = [name for name in bare if frames[name][0] not in with_mass]
    return [name for name in held if own[name] is None], unknown


_UNSAFE = re.compile(r"[^A-Za-z0-9._+-]+")


class FileNames:
    """Assigns distinct names to files in the folder of all meshes.

    Subfolders of the deepest common folder are kept, so that meshes with equal names do
    not collide, and relative paths in meshes stay valid. Characters other than ASCII
    letters, digits and ._+- become _, because RViz and Gazebo disagree on URIs with
    spaces.
    """

    def __init__(self, files: Iterable[Path]) -> None:
        files = list(files)
        folders = {str(file.parent) for file in files}
        self._top = Path(os.path.commonpath(folders)) if folders else Path(os.sep)
        self._owners: dict[str, tuple[Path, str]] = {}
        self._given: dict[tuple[Path, str], str] = {}
        # Files that keep their names come first in each folder.
        for file in sorted(
            files, key=lambda file: [bool(_UNSAFE.search(part)) for part in file.parts]
        ):
            self.of(file)

    def of(self, file: Path, name: str = "") -> str:
        """Return the assigned name of a file.

        Args:
            file: One of the files, or a folder above.
            name: Name of a file made from it, such as "x_hull.stl"; empty for itself.

        Returns:
            Path in the folder of all meshes, with slashes.
        """
        if file in (self._top, file.parent):
            return ""
        key = file, name
        if key not in self._given:
            safe = _UNSAFE.sub("_", name or file.name)
            path = os.path.join(self.of(file.parent), safe)
            stem, suffix = os.path.splitext(path)
            number = 1
            while self._owners.setdefault(path, key) != key:
                number += 1
                path = f"{stem}_{number}{suffix}"
            self._given[key] = path
        return self._given[key]


def mesh_prefix(folder: Path) -> tuple[str, str]:
    """Choose how a URDF refers to its meshes.

    Args:
        folder: Folder of the result, an absolute path.

    Returns:
        The prefix of a mesh's name, and a message about it.
    """
    for place in (folder, *folder.parents):
        package = package_name(place / "package.xml")
        if package is None:
            continue
        inside = folder.relative_to(place)
        known = find_folder(package)
        is_plain = re.fullmatch(r"[\w./+-]*", str(inside), re.ASCII) is not None
        if (
            known
            and is_plain
            and os.path.realpath(Path(known) / inside) == os.path.realpath(folder)
        ):
            uri = "/".join([f"package://{package}", *inside.parts, "meshes"])
            return uri, f"Meshes are named `{uri}/...`."
        break
    return "../meshes", (
        "Meshes are named relative to the URDF file (`../meshes/...`), because ROS "
        "finds no package that contains it; `model:=` of the launch files resolves "
        "them."
    )


PROGRESS_PERIOD = 2.0
"""Time between two lines of progress, in [s]."""


@dataclass
class Import:
    """The import of robots into one folder."""

    robots: list[ImportedRobot]
    options: Options
    prefix: str
    """Prefix of mesh names in the URDF."""

    write: Callable[[str, bytes], None]
    """Writes a file of the result, given its name and content."""

    faults: list[str] = field(default_factory=list)
    """A message for each file that is not a robot and was skipped."""

    files: dict[str, MeshFile] = field(default_factory=dict)
    """Meshes of the result by their names in it."""

    _names: FileNames = field(init=False)
    _reader: MeshReader = field(init=False)
    _side_files: dict[Path, tuple[dict[str, Path], list[str]]] = field(init=False)
    _scales: dict[Path, float] = field(default_factory=dict)
    """Largest scale of each mesh."""

    _made: dict[tuple[Path, bool], str | DescriptionError] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Collect the files of the result."""
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
        self._reader = MeshReader(dict.fromkeys(meshes))

    def _references(self) -> Iterable[Reference]:
        """Return the references of all robots."""
        return (ref for robot in self.robots for ref in robot.references)

    def run(self) -> None:
        """Import all robots; report progress on stderr.

        Raises:
            OSError: If something cannot be written.
        """
        total = len([*self._references()])
        done, reported = 0, time.monotonic()
        for robot in self.robots:
            for reference in robot.references:
                self._settle(robot, reference)
                done += 1
                if time.monotonic() - reported > PROGRESS_PERIOD:
                    reported = time.monotonic()
                    print(f"import_model: {done} of {total} meshes", file=sys.stderr)
            _settle_masses(robot)
            for compiler in robot.root.iterfind("mujoco/compiler[@meshdir]"):
                former = compiler.get("meshdir")
                if former != "../meshes":
                    robot.changes.append(
                        f"MuJoCo's meshdir was changed from {former} to ../meshes."
                    )
                    compiler.set("meshdir", "../meshes")
            self.write(robot.name, robot.text())

    def _settle(self, robot: ImportedRobot, reference: Reference) -> None:
        """Set the new name of a mesh or texture, or remove it from the URDF."""
        if not reference.name:
            kind = reference.element.tag
            robot.findings.append(
                f"The {kind} of {reference.owner} has no file name; removed."
            )
            reference.remove()
            return
        if scheme_of(reference.name) not in ("", *FINDABLE):
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
        """Return the name of a file in the result; the first call writes it."""
        key = path, reference.is_collision and self.options.convex_collisions
        if key not in self._made:
            try:
                if reference.is_mesh:
                    use = reference.is_collision, self._scales[path]
                    mesh = make_mesh(path, self._reader, *use, self.options)
                else:
                    mesh = MeshFile(path, data=read_bytes(path))
            except DescriptionError as error:
                self._made[key] = error
                return error
            name = self._names.of(path, mesh.name)
            found, absent = ({}, []) if mesh.name else self._side_files[path]
            gone = tuple(f"refers to {name}, which does not exist" for name in absent)
            self.write(f"meshes/{name}", mesh.data)
            findings = mesh.findings + gone
            self.files[name] = replace(mesh, name=name, data=b"", findings=findings)
            for relative, file in found.items():
                place = os.path.normpath(os.path.join(os.path.dirname(name), relative))
                self.files[place] = MeshFile(file, place)
                self.write(f"meshes/{place}", file.read_bytes())
            self._made[key] = name
        return self._made[key]


def _settle_masses(robot: ImportedRobot) -> None:
    """Write known masses explicitly, and report unknown ones."""
    held, unknown = massless_links(robot.description)
    if held:
        for link in robot.root.findall("link"):
            if link.get("name") not in held:
                continue
            inertial = etree.SubElement(link, "inertial")
            etree.SubElement(inertial, "mass", value="0")
            moments = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
            etree.SubElement(inertial, "inertia", dict.fromkeys(moments, "0"))
            etree.indent(inertial, level=2)
            link.text = link.text or "\n    "
            before = inertial.getprevious()
            if before is not None:
                before.tail = "\n    "
            inertial.tail = "\n  "
        robot.changes.append(
            f"Massless links fixed to a body with mass got an explicit mass of 0: "
            f"{', '.join(held)}."
        )
    robot.findings += [
        f"Link {name} has no mass and is not fixed to a link with mass: Gazebo ignores "
        "it and all links below it."
        for name in unknown
    ]
    faults = {
        part.name: fault_of(part.inertial)
        for part in robot.description.links
        if part.inertial is not None
    }
    robot.findings += [f"Link {name}: {why}." for name, why in faults.items() if why]
