"""The motions to check: given files, and those in folders."""

from __future__ import annotations

import os
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import quote

from g1_description.checks.batch import Task
from g1_description.errors import InvalidValueError, MotionError
from g1_description.motion import selection as selections
from g1_description.motion.files.formats import ENDINGS, is_motion_folder, motion_names
from g1_description.motion.paths import absent, split
from g1_description.motion.selection import Selection
from g1_description.text import listed

SQLITE = ".db3"
"""Extension of ROS 2's other bags: their folders would seem to have no motion."""


@dataclass(frozen=True)
class MotionFiles:
    """Files to check."""

    tasks: tuple[Task, ...]

    named: frozenset[str]
    """Names of motions whose files were given one by one."""

    n_left_out: int
    """Number of files in folders with other extensions."""

    n_excluded: int = 0
    """Number of files that a selection does not keep."""

    @property
    def remarks(self) -> str:
        """Counts of the files that are ignored or excluded, for the last line."""
        others = self.n_left_out
        more = f"; ignored {others} with other extensions" if others else ""
        if self.n_excluded:
            more += f"; {self.n_excluded} excluded by the selection"
        return more


def motion_files(
    paths: Sequence[Path],
    every: bool = False,
    selection: Selection | None = None,
    repeats: bool = False,
    reports: Collection[str] = (),
) -> MotionFiles:
    """Find the motions.

    Args:
        paths: Files, ``FILE#NAME``, and folders; some of these are one motion.
        every: Whether each motion of a file that has several is a task.
        selection: Motions to take; None: all.
        repeats: Whether a motion that is given again is another task.
        reports: Real paths of files in folders that are no motions.

    Returns:
        Each once, unless ``repeats``, in the order of the paths; those of a folder by
        their names.

    Raises:
        InvalidValueError: If a file does not exist, a folder has no motions, or the
            selection keeps none.
    """
    found: dict[tuple[str, int], tuple[str, Path, Path | None]] = {}
    named, n_left_out = set(), 0

    def add(path: Path, folder: Path | None = None) -> list[str]:
        """Add a file, unless it was found by another name; return its first names."""
        first = []
        for name in _names(path) if every else [path]:
            file, part = split(name)  # equal for all names of a motion
            real = os.path.realpath(file) + ("" if part is None else f"#{part}")
            key = real, len(found) if repeats else 0
            first.append(found.setdefault(key, (str(name), name, folder))[0])
        return first

    for path in paths:
        file, _ = split(path)
        if not file.is_dir() or is_motion_folder(file):
            if not file.is_file() and not file.is_dir():
                raise InvalidValueError(
                    f"{file} is not a file." if file.exists() else absent(file)
                )
            named.update(add(path))
            continue
        below = [
            file
            for file in _files_below(path)
            if file.name != selections.FILE and os.path.realpath(file) not in reports
        ]
        motions = [
            file
            for file in below
            if file.is_dir() or file.suffix.lower() in (*ENDINGS, SQLITE)
        ]
        if not motions:
            raise InvalidValueError(
                f"The folder {path} has no motions (files that end in "
                f"{', '.join(ENDINGS)})."
            )
        n_left_out += len(below) - len(motions)
        for file in motions:
            add(file, path)
    kept = [*found.values()]
    if selection is not None:
        kept = [item for item in kept if selection.keeps(*item[1:])]
        if not kept:
            raise InvalidValueError(f"{selection.path} excludes all motions.")
    tasks = [Task(number, *item[:2]) for number, item in enumerate(kept)]
    n_excluded = len(found) - len(kept)
    return MotionFiles(tuple(tasks), frozenset(named), n_left_out, n_excluded)


def unmatched(selection: Selection | None) -> str:
    """Say which entries of a selection have no motion; empty if there are none."""
    names = [] if selection is None else selection.unmatched()
    if selection is None or not names:
        return ""
    begin = f"{len(names)} entries" if len(names) > 1 else "1 entry"
    verb = "match" if len(names) > 1 else "matches"
    return f"{begin} of {selection.path} {verb} no motion: {listed(names)}."


def _names(path: Path) -> list[Path]:
    """List the motions of a file that has several; else the file itself."""
    if split(path)[1] is not None:
        return [path]
    try:
        names = motion_names(path)
    except MotionError:  # its reader reports it
        return [path]
    several = len(names) > 1
    return [Path(f"{path}#{name}") for name in names] if several else [path]


def _files_below(folder: Path) -> Iterator[Path]:
    """Find files in a folder and its subfolders, sorted; hidden ones are ignored.

    A folder that is a motion stands for its files.
    """

    def refuse(error: OSError) -> None:
        raise InvalidValueError(
            f"{error.filename} cannot be read: {error.strerror}."
        ) from error

    for place, folders, files in os.walk(folder, onerror=refuse):
        folders[:] = sorted(name for name in folders if not name.startswith("."))
        whole = [name for name in folders if is_motion_folder(Path(place, name))]
        yield from (Path(place, name) for name in whole)
        folders[:] = [name for name in folders if name not in whole]
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
    parts = [split(task.path) for task in tasks]
    absolute = [Path(os.path.abspath(path)) for path, _ in parts]
    common = os.path.commonpath([path.parent for path in absolute])
    names = [path.relative_to(common) for path in absolute]
    # A motion's name may have slashes.
    ends = ["" if name is None else f"#{quote(name, ' ')}" for _, name in parts]
    return [n.with_name(f"{n.name}{end}.png") for n, end in zip(names, ends)]
