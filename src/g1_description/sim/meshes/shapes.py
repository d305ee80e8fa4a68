"""Finding and validating meshes for PyBullet, whose own readers trust any file.

PyBullet may read a binary STL itself, after its length and numbers were checked. Other
files are read with assimp, as in RViz, in a child process.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from g1_description.bounds import MAX_VALUE
from g1_description.files.model_files import find_folder
from g1_description.files.uris import local_path
from g1_description.robot.description import Shape
from g1_description.sim.meshes.contents import Part, mesh_contents
from g1_description.sim.meshes.stl import (
    HEAD,
    RECORD,
    binary_size,
    has_direction,
    triangle_count,
    triangle_normals,
)

KINDS = (".dae", ".obj", ".stl")
"""Kinds of meshes that Gazebo takes."""


@dataclass(frozen=True)
class Mesh:
    """A mesh file."""

    path: Path
    parts: tuple[Part, ...] = ()
    """Empty if PyBullet reads the file itself."""


def find_meshes(shapes: Iterable[Shape]) -> tuple[dict[str, Mesh], tuple[str, ...]]:
    """Find and read the meshes of a model.

    Args:
        shapes: Its shapes; those that are not meshes are ignored.

    Returns:
        The meshes by their names in the file, and a message for each that cannot be
        used.
    """
    names = [shape.filename for shape in shapes if shape.kind == "mesh"]
    found: dict[str, Mesh] = {}
    left_out = []
    paths: dict[str, Path] = {}
    for name in dict.fromkeys(names):
        path = local_path(name, find_folder)
        if path is None:
            left_out.append(f"mesh {name} does not exist")
        elif path.suffix.lower() not in KINDS:
            left_out.append(f"mesh {name} must be one of {', '.join(KINDS)}")
        else:
            paths[name] = path
    meshes = open_meshes(paths.values())
    for name, path in paths.items():
        mesh = meshes[path]
        if isinstance(mesh, str):
            left_out.append(f"mesh {name} cannot be read" + (mesh and f": {mesh}"))
        else:
            found[name] = mesh
    return found, tuple(left_out)


def scaled_parts(mesh: Mesh, scale: Sequence[float]) -> list[Part]:
    """Read the triangles of a mesh, to be drawn at a scale.

    Args:
        mesh: The mesh.
        scale: Along x, y and z; negative ones mirror it.

    Returns:
        Its parts, with normals of length 1 or 0. Their triangles are anticlockwise seen
        from outside, as those of the mesh.
    """
    parts = mesh.parts
    if not parts:
        records = np.fromfile(str(mesh.path), RECORD, offset=HEAD)
        normals = np.repeat(records["normal"][:, np.newaxis], 3, axis=1)
        parts = (Part(records["corners"], normals, None),)
    factors = np.array(scale)
    turn = 1 if np.prod(factors) > 0 else -1
    found = []
    for part in parts:
        with np.errstate(all="ignore"):
            normals = part.normals / factors
            normals /= np.linalg.norm(normals, axis=2, keepdims=True)
        corners = (part.corners * factors)[:, ::turn]
        found.append(Part(corners, np.nan_to_num(normals)[:, ::turn], part.color))
    return found


def is_there(shape: Shape, meshes: Mapping[str, Mesh]) -> bool:
    """Return whether a shape is not a mesh, or one that was found."""
    return shape.kind != "mesh" or shape.filename in meshes


def open_meshes(paths: Iterable[Path]) -> dict[Path, Mesh | str]:
    """Open mesh files.

    Args:
        paths: Existing files of these ``KINDS``.

    Returns:
        By file: a mesh, or a message on why it cannot be read.
    """
    found: dict[Path, Mesh | str] = {}
    unread = []
    for path in dict.fromkeys(paths):
        if is_sound_stl(path):
            found[path] = Mesh(path)
        else:
            unread.append(path)
    for path, content in mesh_contents(unread).items():
        found[path] = content if isinstance(content, str) else Mesh(path, content)
    return found


def is_sound_stl(path: Path) -> bool:
    """Return whether a file is a binary STL that PyBullet can read safely.

    Its size must match its number of triangles, as PyBullet computes it in 32 bits and
    reads beyond the end. It must have normals, without which it is black.

    Args:
        path: An existing file.
    """
    if path.suffix.lower() != ".stl":
        return False
    try:
        size = path.stat().st_size
        with path.open("rb") as file:
            head = file.read(HEAD)
        count = triangle_count(head)
        if not count or size != binary_size(head):
            return False
        records = np.fromfile(str(path), RECORD, count, offset=HEAD)
    except OSError:
        return False
    with np.errstate(invalid="ignore"):
        if not (np.abs(records["corners"]) <= MAX_VALUE).all():
            return False
    mute = records["corners"][~has_direction(records["normal"])]
    # Triangles without area are invisible and need no normal.
    return not triangle_normals(mute).any()
