"""Meshes as they are in the result: what is made of a file, and what was changed."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ..core.errors import DescriptionError
from .companions import companions_of
from .shapes import (
    MakeFewer,
    convex_hull,
    decimated,
    decimated_hull,
    read_obj,
    within,
)
from .stl import clean_stl, read_stl, write_stl

TOLERANCE = 0.002
"""How far a surface may move where nothing is asked for, in [m]."""


@dataclass(frozen=True)
class Wishes:
    """What a user wants of meshes."""

    most_triangles: int | None = None
    """Of each mesh; None for as many as there are."""

    tolerance: float = TOLERANCE
    """How far fewer triangles may move a surface of the robot, in [m]."""

    convex_collisions: bool = False
    keep_missing: bool = False
    """Whether meshes that are missing stay in the URDF."""


@dataclass(frozen=True)
class Mesh:
    """A mesh of the result."""

    data: bytes
    name: str
    """Name of the file if it is not that of the source, else empty."""

    triangles: int | None = None
    """How many it has; None where they were not counted."""

    changes: tuple[str, ...] = ()
    findings: tuple[str, ...] = ()
    moved: float | None = None
    """How far its surface moved, in [m]; None where no triangle was taken away."""


def make_mesh(path: Path, is_collision: bool, scale: float, wishes: Wishes) -> Mesh:
    """Make a mesh of the result.

    STL is cleaned; OBJ and DAE are kept, with their materials. Hulls are made of STL
    and OBJ, of decimated meshes STL and OBJ without materials.

    Args:
        path: An existing file.
        is_collision: Whether it is for collisions.
        scale: By how much the robot magnifies it, in [m] per unit of the file.
        wishes: What to make of it.

    Returns:
        The mesh.

    Raises:
        DescriptionError: If it cannot be read.
    """
    try:
        data = path.read_bytes()
    except OSError as error:
        raise DescriptionError(f"it cannot be read: {error.strerror}") from error
    if not data:
        raise DescriptionError("it is empty")
    kind = path.suffix.lower()
    changes: tuple[str, ...] = ()
    if kind == ".stl":
        data, changes = clean_stl(data)
    kept = Mesh(data, "", _count(kind, data), changes, _unread(kind))
    wants_hull = is_collision and wishes.convex_collisions
    if not wants_hull and wishes.most_triangles is None:
        return kept
    if kind not in (".stl", ".obj"):
        return _as_it_is(kept, f"kept as it is: of {kind} nothing is made")
    triangles = read_stl(data) if kind == ".stl" else read_obj(path)
    if wants_hull:
        return _hull(kept, path, triangles, scale, wishes)
    if kind == ".obj" and any(companions_of(path)):
        return _as_it_is(kept, "kept as it is: it would lose its materials")
    fewer = _fewer(kept, triangles, scale, wishes, decimated)
    if kind == ".obj" and fewer.moved is not None:
        return replace(fewer, name=f"{path.stem}.stl")
    return fewer


def _hull(
    kept: Mesh, path: Path, triangles: np.ndarray, scale: float, wishes: Wishes
) -> Mesh:
    """Make the convex hull of a mesh, if it has one."""
    try:
        hull = convex_hull(triangles)
    except DescriptionError as error:
        return _as_it_is(kept, f"kept as it is: {error}")
    told = f"convex hull, {len(hull)} triangles for {len(triangles)}"
    mesh = Mesh(write_stl(hull), f"{path.stem}_hull.stl", len(hull), (told,))
    return _fewer(mesh, hull, scale, wishes, decimated_hull)


def _fewer(
    mesh: Mesh,
    triangles: np.ndarray,
    scale: float,
    wishes: Wishes,
    make_fewer: MakeFewer,
) -> Mesh:
    """Give a mesh of these triangles with fewer of them, if it has too many."""
    most = wishes.most_triangles or len(triangles)
    if len(triangles) <= most:
        return mesh
    fewer, moved = within(wishes.tolerance / scale, triangles, most, make_fewer)
    findings = mesh.findings
    if len(fewer) > most:
        findings += (
            f"has {len(fewer)} triangles: fewer cannot be made, or would move it by "
            f"more than {millimetres(wishes.tolerance)}",
        )
    if len(fewer) == len(triangles):
        return replace(mesh, findings=findings)
    told = f"{len(fewer)} triangles for {len(triangles)}"
    moved *= scale
    changes = (*mesh.changes, told, f"moved by {millimetres(moved)}")
    return Mesh(write_stl(fewer), mesh.name, len(fewer), changes, findings, moved)


def millimetres(distance: float) -> str:
    """Write a distance in [m] for people."""
    return f"{1000.0 * distance:.2g} mm"


def _count(kind: str, data: bytes) -> int | None:
    """Count the triangles of an STL."""
    return len(read_stl(data)) if kind == ".stl" else None


def _unread(kind: str) -> tuple[str, ...]:
    """Tell if a kind of mesh is not for everybody."""
    if kind in (".stl", ".obj", ".dae"):
        return ()
    return (f"neither Gazebo nor the stand-in reads {kind or 'a file without suffix'}",)


def _as_it_is(mesh: Mesh, why: str) -> Mesh:
    """Give a mesh with a finding."""
    findings = (*mesh.findings, why)
    return Mesh(mesh.data, mesh.name, mesh.triangles, mesh.changes, findings)
