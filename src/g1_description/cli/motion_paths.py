"""The files to check: given files, and motions in folders."""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from g1_description.checks.batch import Task
from g1_description.errors import InvalidValueError
from g1_description.motion import selection as selections
from g1_description.motion.files.formats import ENDINGS
from g1_description.motion.selection import Selection


@dataclass(frozen=True)
class MotionFiles:
    """Files to check."""

    tasks: tuple[Task, ...]

    named: frozenset[str]
    """Names of files that were given one by one."""

    n_left_out: int
    """Number of files in folders with other extensions."""

    n_excluded: int = 0
    """Number of files that a selection does not keep."""


def motion_files(
    paths: Sequence[Path], selection: Selection | None = None
) -> MotionFiles:
    """Find the files.

    Args:
        paths: Files and folders.
        selection: Those to take; None: all.

    Returns:
        Each file once, in the order of the paths; those of a folder by their names.

    Raises:
        InvalidValueError: If a file does not exist, a folder has no motions, or the
            selection keeps none.
    """
    found: dict[str, tuple[str, Path]] = {}
    named, n_left_out = set(), 0

    def add(path: Path) -> str:
        """Add a file, unless it was found by another name; return its first name."""
        return found.setdefault(os.path.realpath(path), (str(path), path))[0]

    for path in paths:
        if not path.is_dir():
            if not path.is_file():
                what = "is not a file" if path.exists() else "does not exist"
                raise InvalidValueError(f"{path} {what}.")
            named.add(add(path))
            continue
        below = [f for f in _files_below(path) if f.name != selections.FILE]
        motions = [file for file in below if file.suffix.lower() in ENDINGS]
        if not motions:
            raise InvalidValueError(
                f"The folder {path} has no motions (files that end in "
                f"{', '.join(ENDINGS)})."
            )
        n_left_out += len(below) - len(motions)
        for file in motions:
            add(file)
    kept = [*found.values()]
    if selection is not None:
        kept = [item for item in kept if selection.keeps(item[1])]
        if not kept:
            raise InvalidValueError(f"{selection.path} excludes all motions.")
    tasks = [Task(number, *item) for number, item in enumerate(kept)]
    n_excluded = len(found) - len(kept)
    return MotionFiles(tuple(tasks), frozenset(named), n_left_out, n_excluded)


def _files_below(folder: Path) -> Iterator[Path]:
    """Find files in a folder and its subfolders, sorted; hidden ones are ignored."""

    def refuse(error: OSError) -> None:
        raise InvalidValueError(
            f"{error.filename} cannot be read: {error.strerror}."
        ) from error

    for place, folders, files in os.walk(folder, onerror=refuse):
        folders[:] = sorted(name for name in folders if not name.startswith("."))
        for name in sorted(files):
            path = Path(place, name)
            if not name.startswith(".") and path.is_file():
                yield path


def picture_names(tasks: Sequence[Task]) -> list[Path]:
    """Name a picture for each file, below a folder.

    Args:
        tasks: The files.

    Returns:
        Distinct paths relative to the common folder of all files.
    """
    absolute = [Path(os.path.abspath(task.path)) for task in tasks]
    common = os.path.commonpath([path.parent for path in absolute])
    names = [path.relative_to(common) for path in absolute]
    return [name.with_name(f"{name.name}.png") for name in names]
