"""Side files of meshes: the materials and textures that they name."""

from __future__ import annotations

import os
import re
from pathlib import Path
from urllib.parse import unquote

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
            relative = _existing(file.parent, name)
            if relative is None:
                absent.append(name)
                continue
            place = os.path.normpath(os.path.join(folder, relative))
            if place not in found:
                found[place] = file.parent / relative
                waiting.append((found[place], os.path.dirname(place)))
    return found, absent


def _names_in(file: Path) -> list[str]:
    """List what a file names by relative paths."""
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
        names = [word for name in names for word in _libraries(file.parent, name)]
    local = (name for name in names if "://" not in name and not os.path.isabs(name))
    return list(dict.fromkeys(local))


def _libraries(folder: Path, names: str) -> list[str]:
    """Split the names after mtllib, unless they are one name with spaces."""
    return [names] if (folder / names).is_file() else names.split()


def _existing(folder: Path, name: str) -> str | None:
    """Return the reading of a name that is an existing file.

    A DAE writes spaces as %20; an MTL may have options before the name.
    """
    for reading in (name, unquote(name), name.split()[-1]):
        if (folder / reading).is_file():
            return reading
    return None
