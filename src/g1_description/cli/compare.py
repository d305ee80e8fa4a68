"""Executed motions beside their references: ``check --against``."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

from g1_description.checks.batch import FileChecker
from g1_description.checks.comparison import Comparison, compare
from g1_description.checks.report import FileResult, table
from g1_description.cli.motion_paths import MotionFiles, motion_files
from g1_description.command_line import say
from g1_description.errors import G1DescriptionError, InvalidValueError
from g1_description.motion.files.source import split

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
    references = _references(against) if against.is_dir() else {}
    read: Path | None = None
    for task in files.tasks:
        path = references.get(_name(task.path)) if references else against
        if path is None:
            yield task.name, f"there is no {_name(task.path)} in {against}"
            continue
        if path != read:
            read, reference, verdict = path, checker.read(str(path), path), None
        executed = checker.read(task.name, task.path)
        if isinstance(reference, FileResult) or isinstance(executed, FileResult):
            each = reference if isinstance(reference, FileResult) else executed
            yield task.name, each.problem  # type: ignore[union-attr]
            continue
        try:
            verdict = verdict or checker.checker.check(reference)
            found = compare(checker.checker, reference, executed, shift, verdict)
            yield task.name, found
        except G1DescriptionError as error:
            yield task.name, str(error)


def _references(folder: Path) -> Mapping[str, Path]:
    """Find the references below a folder, by name without extension."""
    found: dict[str, Path] = {}
    for task in motion_files([folder], every=True).tasks:
        name = _name(task.path)
        if name in found:
            raise InvalidValueError(
                f"{folder} has two motions called {name}: {found[name]} and "
                f"{task.path}."
            )
        found[name] = task.path
    return found


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
