"""Names of the files of the result, and how its URDF refers to the meshes."""

from __future__ import annotations

import os
import re
from collections.abc import Iterable
from pathlib import Path

from g1_description.core.files.model_files import find_folder
from g1_description.core.files.uris import package_name

_UNSAFE = re.compile(r"[^A-Za-z0-9._+-]+")


class FileNames:
    """Gives each file a name of its own in the folder of all meshes.

    Folders below the deepest common one are kept: so meshes with equal names do not
    collide, and relative paths inside meshes stay valid. Characters other than ASCII
    letters, digits and ._+- become _, because RViz and Gazebo disagree on URIs with
    spaces; files that need no such change keep their names.
    """

    def __init__(self, files: Iterable[Path]) -> None:
        """Set all files of the result, as absolute paths."""
        files = list(files)
        folders = {str(file.parent) for file in files}
        self._top = Path(os.path.commonpath(folders)) if folders else Path(os.sep)
        self._owners: dict[str, tuple[Path, str]] = {}
        self._given: dict[tuple[Path, str], str] = {}
        for file in sorted(files, key=_unsafe_parts):
            self.of(file)

    def of(self, file: Path, name: str = "") -> str:
        """Return the name of a file, always the same one.

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
            parent = self.of(file.parent)
            self._given[key] = self._free(os.path.join(parent, safe), key)
        return self._given[key]

    def _free(self, name: str, key: tuple[Path, str]) -> str:
        """Append a number to a name that another file has."""
        stem, suffix = os.path.splitext(name)
        number = 1
        while self._owners.setdefault(name, key) != key:
            number += 1
            name = f"{stem}_{number}{suffix}"
        return name


def _unsafe_parts(file: Path) -> list[bool]:
    """Sort key that puts files that keep their names first in each folder."""
    return [_UNSAFE.search(part) is not None for part in file.parts]


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
