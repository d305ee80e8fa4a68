"""Where the command motion writes motions."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

from g1_description.bridge.recorded_file import WRITERS
from g1_description.checks.batch import Task
from g1_description.cli.motion_edits import Edit
from g1_description.errors import InvalidValueError
from g1_description.motion.files.formats import writer_of
from g1_description.motion.paths import as_file, split
from g1_description.text import listed


def is_merged(args: Edit, tasks: Sequence[Task]) -> bool:
    """Return whether all motions are written to one file."""
    is_whole = len(tasks) == 1 and tasks[0].path in args.files
    writer = None if args.to is None else WRITERS[args.to]
    if writer is None or writer.merged is None or is_whole or args.out.is_dir():
        return False
    return args.out.suffix.lower() == writer.ending


def places_of(args: Edit, tasks: Sequence[Task]) -> dict[str, Path]:
    """Choose where motions are written.

    Returns:
        Files or folders by the names of the tasks.

    Raises:
        InvalidValueError: If ``--out`` is neither a file for one motion nor a folder.
        MotionError: If the format is unknown.
    """
    out = args.out
    endings = {writer.ending for writer in WRITERS.values()} - {""}
    is_named = out.suffix.lower() in endings
    is_single = len(tasks) == 1 and tasks[0].path in args.files
    is_folder = args.to is not None and not WRITERS[args.to].ending
    if not out.is_dir() and (is_named or (is_folder and is_single)):
        if len(tasks) > 1 and not is_merged(args, tasks):
            raise InvalidValueError(
                f"--out must be a folder for {len(tasks)} motions (got {out})."
            )
        if args.to is not None and WRITERS[args.to].ending != out.suffix.lower():
            raise InvalidValueError(
                f"{args.to} files end in {WRITERS[args.to].ending or 'nothing'} (got "
                f"{out})."
            )
        return {task.name: out for task in tasks}
    if args.to is None and not out.is_dir() and out.suffix:
        writer_of(out, None, WRITERS)  # says which endings there are
    if args.to is None:
        raise InvalidValueError(
            f"--out {out} is a folder, so --to must name the format: "
            f"{', '.join(WRITERS)}."
        )
    for path in args.files:
        if path.is_dir() and _is_inside(out, path):
            raise InvalidValueError(
                f"--out {out} must not be in {path}, a folder read."
            )
    return _in_folder(out, tasks, WRITERS[args.to].ending)


def _is_inside(path: Path, folder: Path) -> bool:
    """Return whether a path is a folder, or in it."""
    real = Path(os.path.realpath(path))
    outer = Path(os.path.realpath(folder))
    return real == outer or outer in real.parents


def _in_folder(out: Path, tasks: Sequence[Task], ending: str) -> dict[str, Path]:
    """Name a file for each motion, as the files lie in their common folder."""
    sources = [(task, *split(task.path)) for task in tasks]
    absolute = [Path(os.path.abspath(file)) for _, file, _ in sources]
    common = os.path.commonpath([path.parent for path in absolute])
    relative = [path.relative_to(common) for path in absolute]
    short = {  # a folder has no extension
        file: file if path.is_dir() else file.with_suffix("")
        for file, path in zip(relative, absolute)
    }
    stems = Counter(short.values())
    places = {}
    for (task, _, name), file in zip(sources, relative):
        # Two files may differ in their extensions only.
        stem = file if stems[short[file]] > 1 else short[file]
        if name:
            stem = stem / as_file(name)
        places[task.name] = out / stem.with_name(stem.name + ending)
    twice = [str(place) for place, n in Counter(places.values()).items() if n > 1]
    if twice:
        raise InvalidValueError(
            f"Several motions would be written to {listed(twice)}; convert them one by "
            "one."
        )
    return places
