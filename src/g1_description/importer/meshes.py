"""Meshes as they are in the result: what is made of a file, and what was changed."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..core.errors import DescriptionError
from .companions import companions_of
from .shapes import convex_hull, decimated, read_obj
from .stl import clean_stl, read_stl, write_stl


@dataclass(frozen=True)
class Wishes:
    """What a user wants of meshes."""

    most_triangles: int | None = None
    """Of each mesh; None for as many as there are."""

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


def make_mesh(path: Path, is_collision: bool, wishes: Wishes) -> Mesh:
    """Make a mesh of the result.

    STL is cleaned; OBJ and DAE are kept, with their materials. Hulls are made of STL
    and OBJ, of decimated meshes STL and OBJ without materials.

    Args:
        path: An existing file.
        is_collision: Whether it is for collisions.
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
        return _hull(kept, path, triangles, wishes.most_triangles)
    if kind == ".obj" and any(companions_of(path)):
        return _as_it_is(kept, "kept as it is: it would lose its materials")
    return _fewer(kept, path, triangles, wishes.most_triangles or len(triangles))


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


def _hull(kept: Mesh, path: Path, triangles: np.ndarray, most: int | None) -> Mesh:
    """Make the convex hull of a mesh, if it has one."""
    try:
        hull = convex_hull(triangles, most)
    except DescriptionError as error:
        return _as_it_is(kept, f"kept as it is: {error}")
    told = f"convex hull, {len(hull)} triangles for {len(triangles)}"
    return Mesh(write_stl(hull), f"{path.stem}_hull.stl", len(hull), (told,))


def _fewer(kept: Mesh, path: Path, triangles: np.ndarray, most: int) -> Mesh:
    """Make a mesh with fewer triangles, if it has too many."""
    fewer = decimated(triangles, most)
    if len(fewer) == len(triangles) and len(triangles) <= most:
        return kept
    told = f"{len(fewer)} triangles for {len(triangles)}"
    findings = kept.findings
    if len(fewer) > most:
        findings += (f"has {len(fewer)} triangles, fewer could not be made of it",)
    name = "" if path.suffix.lower() == ".stl" else f"{path.stem}.stl"
    return Mesh(write_stl(fewer), name, len(fewer), (*kept.changes, told), findings)
