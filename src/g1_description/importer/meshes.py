"""Conversion of meshes, with a record of changes."""

from __future__ import annotations

import os
import re
from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from urllib.parse import unquote

import numpy as np

from g1_description.errors import DescriptionError
from g1_description.importer.simplify import (
    MakeFewer,
    convex_hull,
    decimated,
    decimated_hull,
    within,
)
from g1_description.sim.meshes import shapes
from g1_description.sim.meshes.stl import clean_header, is_binary, read_stl, write_stl

_NAMED = {
    ".obj": re.compile(rb"^\s*mtllib\s+(.+?)\s*$", re.MULTILINE),
    ".mtl": re.compile(
        rb"^\s*(?:map_\w+|bump|disp|decal|norm|refl)\s+(.+?)\s*$", re.MULTILINE | re.I
    ),
    ".dae": re.compile(rb"<init_from>(?:<ref>)?\s*([^<>]+?)\s*<"),
}

_IMAGE = re.compile(rb"<image\b[^>]*(?<!/)>.*?</image>", re.DOTALL)
"""A picture of a DAE; init_from is also in surfaces, where it names an image."""


def side_files_of(mesh: Path) -> tuple[dict[str, Path], list[str]]:
    """Find the side files of a mesh.

    Args:
        mesh: An existing file.

    Returns:
        The files by their paths relative to the mesh's folder; and the names of
        files that do not exist.
    """
    found: dict[str, Path] = {}
    absent: list[str] = []
    waiting = [(mesh, "")]
    while waiting:
        file, folder = waiting.pop()
        for name in _names_in(file):
            # A DAE writes spaces as %20; an MTL may have options before the name.
            readings = (name, unquote(name), name.split()[-1])
            known = (one for one in readings if (file.parent / one).is_file())
            relative = next(known, None)
            if relative is None:
                absent.append(name)
                continue
            place = os.path.normpath(os.path.join(folder, relative))
            if place not in found:
                found[place] = file.parent / relative
                waiting.append((found[place], os.path.dirname(place)))
    return found, absent


def _names_in(file: Path) -> list[str]:
    """List files that a file names by relative paths."""
    kind = file.suffix.lower()
    pattern = _NAMED.get(kind)
    if pattern is None:
        return []
    try:
        data = file.read_bytes()
        if kind == ".dae":
            data = b"".join(_IMAGE.findall(data))
        names = [name.decode("utf-8") for name in pattern.findall(data)]
    except (OSError, UnicodeDecodeError):
        return []
    if kind == ".obj":
        # After mtllib are names, or one name with spaces.
        names = [
            word
            for name in names
            for word in ([name] if (file.parent / name).is_file() else name.split())
        ]
    local = (name for name in names if "://" not in name and not os.path.isabs(name))
    return list(dict.fromkeys(local))


TOLERANCE = 0.002
"""Default of how far decimation may move a surface, in [m]."""

AT_A_TIME = 10
"""Files per child process, which is slow to start.

Even if each takes its limit of processor time, the total timeout is not exceeded.
"""


@dataclass(frozen=True)
class Options:
    """Options for meshes."""

    most_triangles: int | None = None
    """Limit for each mesh; None: no limit."""

    tolerance: float = TOLERANCE
    """Largest deviation of a decimated surface, in [m]."""

    convex_collisions: bool = False
    keep_missing: bool = False
    """Whether to keep references to missing meshes in the URDF."""


@dataclass(frozen=True)
class MeshFile:
    """A file of the result."""

    source: Path
    name: str = ""
    """Name in the result; empty: that of the source."""

    data: bytes = b""
    triangles: int | None = None
    """Number of triangles; None if they were not counted."""

    changes: tuple[str, ...] = ()
    findings: tuple[str, ...] = ()
    moved: float | None = None
    """Deviation of the decimated surface, in [m]; None if it was not decimated."""

    def kept(self, why: str) -> MeshFile:
        """Return a copy with a finding on why it is unchanged."""
        return replace(self, findings=(*self.findings, f"kept unchanged: {why}"))


class MeshReader:
    """Reads existing files as the simulator does, several at a time in order of use."""

    def __init__(self, paths: Iterable[Path]) -> None:
        self._paths = [path for path in paths if path.suffix.lower() in shapes.KINDS]
        self._found: dict[Path, shapes.Mesh | str] = {}

    def read(self, path: Path) -> shapes.Mesh:
        """Read a file, and the next ones.

        Raises:
            DescriptionError: If it cannot be read.
        """
        if path not in self._found:
            first = self._paths.index(path)
            self._found = shapes.open_meshes(self._paths[first : first + AT_A_TIME])
        found = self._found[path]
        if isinstance(found, str):
            raise DescriptionError(found)
        return found


def make_mesh(
    path: Path, reader: MeshReader, is_collision: bool, scale: float, options: Options
) -> MeshFile:
    """Make a mesh of the result.

    STL becomes binary; OBJ and DAE are kept, with their materials. Hulls are made of
    STL and OBJ, of decimated meshes STL and OBJ without materials.

    Args:
        path: An existing file.
        reader: Reads meshes.
        is_collision: Whether it is for collisions.
        scale: Scale in the URDF, in [m] per unit of the file.
        options: Options for meshes.

    Returns:
        The mesh.

    Raises:
        DescriptionError: If it cannot be read; the message says why.
    """
    kind = path.suffix.lower()
    data = read_bytes(path)
    if kind not in shapes.KINDS:
        note = (
            f"neither Gazebo nor the simulator reads {kind or 'a file without suffix'}"
        )
        kept = MeshFile(path, data=data, findings=(note,))
        triangles = None
    else:
        parts = reader.read(path).parts
        corners = [part.corners for part in parts]  # none if it is sound and binary
        triangles = np.concatenate(corners) if parts else read_stl(data)
        kept = MeshFile(path, data=data)
        if kind == ".stl":
            if not parts:
                data, changes = clean_header(data)
            elif is_binary(data):
                data, changes = write_stl(triangles), ("normals computed",)
            else:
                data, changes = write_stl(triangles), ("text made binary",)
            count = len(read_stl(data))
            kept = MeshFile(path, data=data, triangles=count, changes=changes)
    is_convex = is_collision and options.convex_collisions
    if not is_convex and options.most_triangles is None:
        return kept
    if triangles is None or kind == ".dae":
        return kept.kept(f"{kind} meshes are not converted")
    if is_convex:
        return _hull(kept, triangles, scale, options)
    if kind == ".obj" and any(side_files_of(path)):
        return kept.kept("it would lose its materials")
    fewer = _fewer(kept, triangles, scale, options, decimated)
    if kind == ".obj" and fewer.moved is not None:
        return replace(fewer, name=f"{path.stem}.stl")
    return fewer


def read_bytes(path: Path) -> bytes:
    """Read a file.

    Raises:
        DescriptionError: If it cannot be read; the message says why.
    """
    try:
        return path.read_bytes()
    except OSError as error:
        raise DescriptionError(str(error.strerror)) from error


def _hull(
    kept: MeshFile, triangles: np.ndarray, scale: float, options: Options
) -> MeshFile:
    """Make the convex hull of a mesh, if it has one."""
    try:
        hull = convex_hull(triangles)
    except DescriptionError as error:
        return kept.kept(str(error))
    note = f"convex hull, {len(hull)} triangles instead of {len(triangles)}"
    name = f"{kept.source.stem}_hull.stl"
    mesh = MeshFile(kept.source, name, write_stl(hull), len(hull), (note,))
    return _fewer(mesh, hull, scale, options, decimated_hull)


def _fewer(
    mesh: MeshFile,
    triangles: np.ndarray,
    scale: float,
    options: Options,
    make_fewer: MakeFewer,
) -> MeshFile:
    """Decimate a mesh, if it has too many triangles."""
    most = options.most_triangles or len(triangles)
    if len(triangles) <= most:
        return mesh
    fewer, moved = within(options.tolerance / scale, triangles, most, make_fewer)
    findings = mesh.findings
    if len(fewer) > most:
        findings += (
            f"still has {len(fewer)} triangles: fewer would move its surface by more "
            f"than {millimetres(options.tolerance)}",
        )
    if len(fewer) == len(triangles):
        return replace(mesh, findings=findings)
    note = f"{len(fewer)} triangles instead of {len(triangles)}"
    moved *= scale
    changes = (*mesh.changes, note, f"moved by {millimetres(moved)}")
    return MeshFile(
        mesh.source, mesh.name, write_stl(fewer), len(fewer), changes, findings, moved
    )


def millimetres(distance: float) -> str:
    """Format a distance in [m]."""
    return f"{1000.0 * distance:.2g} mm"
