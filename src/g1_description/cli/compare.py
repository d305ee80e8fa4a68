"""Executed motions beside their references: ``check --against``."""

from __future__ import annotations

import json
from collections import defaultdict
from collections.abc import Iterator, Sequence
from functools import lru_cache
from pathlib import Path

from g1_description.checks.batch import FileChecker
from g1_description.checks.comparison import Comparison, compare
from g1_description.checks.report import FileResult, table
from g1_description.cli.motion_paths import MotionFiles, motion_files
from g1_description.command_line import say
from g1_description.errors import G1DescriptionError
from g1_description.motion.files.formats import is_motion_folder
from g1_description.motion.paths import split

HEAD = ("", "shift", "joints", "bodies", "from the root", "largest slip", "")


def comparisons(
    checker: FileChecker, files: MotionFiles, against: Path, shift: float | None
) -> Iterator[tuple[str, Comparison | str]]:
    """Compare files with their references.

    Args:
        checker: Reads and checks motions.
        files: The executed motions.
        against: The reference, or a folder of references with the names of the executed
            motions, whatever their extensions are.
        shift: Time shift in [s]; None: it is found.

    Yields:
        Name of a file, and its comparison, or why there is none.

    Raises:
        InvalidValueError: If the folder has no motions.
    """
    references = Pairs(against)
    # Once, where all are compared with the same one.
    read = lru_cache(maxsize=1)(lambda path: checker.read(str(path), path))
    for task in files.tasks:
        found = references.of(task.path)
        if isinstance(found, str):
            yield task.name, found
            continue
        reference, executed = read(found), checker.read(task.name, task.path)
        if isinstance(reference, FileResult):
            yield task.name, reference.problem
        elif isinstance(executed, FileResult):
            yield task.name, executed.problem
        else:
            try:
                yield task.name, compare(checker.checker, reference, executed, shift)
            except G1DescriptionError as error:
                yield task.name, str(error)


class Pairs:
    """References by their paths and names."""

    def __init__(self, against: Path) -> None:
        """Find the references.

        Args:
            against: The only one, or a folder with some below it.

        Raises:
            InvalidValueError: If the folder has no motions.
        """
        self._against, self._by_name = against, defaultdict(list)
        if against.is_dir() and not is_motion_folder(against):
            for task in motion_files([against], every=True).tasks:
                self._by_name[_name(task.path)].append(task.path)

    def of(self, executed: Path) -> Path | str:
        """Return the reference of an executed motion, or why there is none."""
        if not self._by_name:
            return self._against
        found = self._by_name.get(_name(executed), [])
        near = [_common(path, executed) for path in found]
        if not found or near.count(max(near)) > 1:
            how = "several motions are" if found else "no motion is"
            return f"{how} called {_name(executed)} in {self._against}"
        return found[near.index(max(near))]


def _common(one: Path, other: Path) -> int:
    """Count the folders above two files that have the same names, from the files up."""
    pairs = zip(reversed(one.parts[:-1]), reversed(other.parts[:-1]))
    return next((n for n, (a, b) in enumerate(pairs) if a != b), 10**6)


def _name(path: Path) -> str:
    """Name a motion by its file without extension, and its name in the file."""
    file, name = split(path)
    return file.stem if name is None else f"{file.stem}#{name}"


def print_comparisons(found: Sequence[tuple[str, Comparison | str]]) -> None:
    """Print one comparison in full, several as a table with a row each."""
    if len(found) == 1:
        name, comparison = found[0]
        say(f"{name}: {comparison}")
        return
    rows = [HEAD, *(_row(name, comparison) for name, comparison in found)]
    say("\n".join(table(rows, 1)))


def _row(name: str, found: Comparison | str) -> tuple[str, ...]:
    """Describe a comparison by rms errors, in a row."""
    if isinstance(found, str):
        return (name, "", "", "", "", "", found)
    rms = [error.rms for error in found.joints.values()]
    total = (sum(value**2 for value in rms) / len(rms)) ** 0.5
    slip = max((after for _, after in found.slip.values()), default=0.0)
    return (
        name,
        f"{found.shift:+.3f} s",
        f"{total:.4f}",
        "" if found.bodies is None else f"{found.bodies.rms:.4f} m",
        f"{found.bodies_from_root.rms:.4f} m",
        f"{slip:.3f} m" if found.slip else "",
        f"{len(found.findings)} findings" if found.findings else "",
    )


def comparisons_json(found: Sequence[tuple[str, Comparison | str]]) -> str:
    """Write comparisons as JSON: a list with an object per file."""
    rows = [
        {"file": name, "problem": comparison}
        if isinstance(comparison, str)
        else {"file": name, **comparison.as_dict()}
        for name, comparison in found
    ]
    return json.dumps(rows, indent=2) + "\n"
