"""Where the files of many folders lie in one, under names that every reader takes."""

from __future__ import annotations

import os
import re
from collections.abc import Iterable
from pathlib import Path

_UNSAFE = re.compile(r"[^A-Za-z0-9._+-]+")


class Places:
    """Gives each file a place of its own.

    Folders below the one that all have in common are kept: meshes of one name don't
    meet, and what a mesh names by a relative path is still there. What is not a
    letter of ASCII, a digit or one of ._+- becomes _, as URIs with spaces are read
    by RViz one way and by Gazebo another; who needs no such change keeps its name.
    """

    def __init__(self, files: Iterable[Path]) -> None:
        """Take all files that there will be, with absolute paths."""
        files = list(files)
        folders = {str(file.parent) for file in files}
        self._top = Path(os.path.commonpath(folders)) if folders else Path(os.sep)
        self._owners: dict[str, tuple[Path, str]] = {}
        self._given: dict[tuple[Path, str], str] = {}
        for file in sorted(files, key=_unsafe_parts):
            self.place(file)

    def place(self, file: Path, name: str = "") -> str:
        """Give the place of a file, the same whenever it is asked for.

        Args:
            file: One of the files, or a folder above.
            name: What is made of it, such as "x_hull.stl"; empty for itself.

        Returns:
            Path in the folder of all meshes, with slashes.
        """
        if file in (self._top, file.parent):
            return ""
        key = file, name
        if key not in self._given:
            safe = _UNSAFE.sub("_", name or file.name)
            parent = self.place(file.parent)
            self._given[key] = self._free(os.path.join(parent, safe), key)
        return self._given[key]

    def _free(self, place: str, key: tuple[Path, str]) -> str:
        """Count up until nobody else has the place."""
        stem, suffix = os.path.splitext(place)
        number = 1
        while self._owners.setdefault(place, key) != key:
            number += 1
            place = f"{stem}_{number}{suffix}"
        return place


def _unsafe_parts(file: Path) -> list[bool]:
    """Order files so that in each folder those that keep their names come first."""
    return [_UNSAFE.search(part) is not None for part in file.parts]
