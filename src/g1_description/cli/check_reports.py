"""Reports of the command check and comparisons with references: their writing."""

from __future__ import annotations

import json
import os
import sys
from collections import defaultdict
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from tempfile import TemporaryDirectory

from g1_description.checks.batch import FileChecker, Task
from g1_description.checks.comparison import Comparison, compare
from g1_description.checks.report import (
    FIRST_COLUMNS,
    NOT_READ,
    FileResult,
    csv_text,
    json_text,
    table,
)
from g1_description.cli.check_options import STDOUT
from g1_description.cli.motion_paths import MotionFiles, motion_files, picture_names
from g1_description.command_line import say
from g1_description.errors import G1DescriptionError, InvalidValueError
from g1_description.files.atomic import whole_file, write_whole
from g1_description.motion.files.formats import is_motion_folder
from g1_description.motion.paths import split
from g1_description.motion.selection import EXCLUDE, UNDECIDED, Choice, Selection
from g1_description.render.page import write_page
from g1_description.robot.description import Description
from g1_description.scenes.objects import SceneObject

OTHER_PICTURES = (".jpg", ".jpeg", ".gif", ".svg", ".pdf")


@dataclass(frozen=True)
class ReportPlaces:
    """Where reports go; None: they are not written."""

    json: str | None
    """A file, or ``STDOUT``."""

    csv: str | None
    """A file, or ``STDOUT``."""

    html: Path | None
    plot: Path | None
    """A picture, or a folder for several."""

    write_selection: Path | None

    @property
    def files(self) -> set[str]:
        """Real paths of the files; not that of a table that is no report."""
        names = [self.json, self.html, self.write_selection]
        names += [self.csv] if self.csv and _is_report(self.csv) else []
        return {os.path.realpath(name) for name in names if name is not None}


def _is_report(name: str) -> bool:
    """Return whether a file is a table of this command, or does not exist."""
    begin = ",".join(FIRST_COLUMNS[:2]).encode()
    try:
        with open(name, "rb") as file:
            return file.read(len(begin)) == begin
    except OSError:
        return True


class Reports:
    """Writes the requested reports: pictures immediately, the rest at the end."""

    def __init__(self, args: ReportPlaces, tasks: Sequence[Task]) -> None:
        """Check that all reports can be written.

        Args:
            args: Arguments of the command line.
            tasks: The files.

        Raises:
            InvalidValueError: If one cannot.
        """
        self._args = args
        self.problems: list[str] = []
        """Messages on reports that could not be written."""
        self._pictures = _pictures(args.plot, tasks)
        for name in (args.json, args.csv, args.html, args.write_selection):
            if name not in (None, STDOUT):
                check_place(Path(name))
        if args.write_selection:
            Selection(args.write_selection, must_exist=False)
        self._tasks = tasks
        motions = {os.path.realpath(task.path) for task in tasks}
        if args.csv and os.path.realpath(args.csv) in motions:
            raise InvalidValueError(
                f"Refusing to overwrite --csv {args.csv}, which "
                "is one of the motions to check."
            )
        # The page embeds all motions at the end; until then they are kept on disk.
        self._kept = TemporaryDirectory(prefix="check_") if args.html else None

    def add(self, task: Task, outcome: FileResult) -> None:
        """Write the picture of a file."""
        if outcome.plot and task.number in self._pictures:
            with self._going_on():
                write_whole(self._pictures[task.number], outcome.plot)
        if self._kept and outcome.scene:
            with self._going_on():
                write_text(str(self._motion(task.number)), outcome.scene)

    def write(
        self,
        outcomes: Mapping[int, FileResult],
        not_done: int,
        robot: Description,
        objects: Collection[SceneObject] = (),
    ) -> None:
        """Write the rest.

        Args:
            outcomes: By the number of the file.
            not_done: Number of files that are not done.
            robot: The robot that the page draws.
            objects: Those around it.
        """
        found = [outcomes[number] for number in sorted(outcomes)]
        if self._args.json:
            with self._going_on():
                listed = self._with_pictures(found, outcomes, self._args.json)
                write_text(self._args.json, json_text(listed, not_done))
        if self._args.csv:
            with self._going_on():
                listed = self._with_pictures(found, outcomes, self._args.csv)
                write_text(self._args.csv, csv_text(listed))
        if self._args.html:
            with self._going_on(), whole_file(self._args.html) as part:
                motions = [self._motion(number) for number in sorted(outcomes)]
                write_page(part, robot, found, motions, not_done, objects)
        if self._args.write_selection:
            with self._going_on():
                self._select(self._args.write_selection, outcomes)

    def _with_pictures(
        self, found: Sequence[FileResult], numbers: Iterable[int], report: str
    ) -> list[FileResult]:
        """Tell a report where the pictures of its files are."""
        folder = "." if report == STDOUT else os.path.dirname(report) or "."
        files = {
            number: os.path.relpath(path, folder)
            for number, path in self._pictures.items()
            if path.exists()
        }
        return [
            replace(outcome, picture=files.get(number, ""))
            for number, outcome in zip(sorted(numbers), found)
        ]

    def _select(self, path: Path, outcomes: Mapping[int, FileResult]) -> None:
        """Exclude motions by the rules, unless a person has decided."""
        selection = Selection(path, must_exist=False)
        for task in self._tasks:
            outcome = outcomes.get(task.number)
            reasons: tuple[str, ...] = ()
            if outcome and outcome.result == NOT_READ:
                reasons = (f"not read: {outcome.problem}",)
            elif outcome and outcome.verdict:
                reasons = outcome.verdict.excluded_by
            chosen = selection.of(task.path)
            if reasons and chosen.choice == UNDECIDED:
                note = "; ".join(filter(None, (chosen.note, *reasons)))
                selection.choose(task.path, Choice(EXCLUDE, note))
        selection.write()

    @contextmanager
    def _going_on(self) -> Iterator[None]:
        """Note an error, and continue with the other reports."""
        try:
            yield
        except InvalidValueError as error:
            self.problems.append(str(error))

    def _motion(self, number: int) -> Path:
        """Return where the motion of a file is kept for the page."""
        assert self._kept is not None
        return Path(self._kept.name, str(number))


def _pictures(out: Path | None, tasks: Sequence[Task]) -> dict[int, Path]:
    """Return the paths of pictures by number of the file."""
    if out is None:
        return {}
    if out.suffix.lower() == ".png" and not out.is_dir():
        if len(tasks) > 1:
            raise InvalidValueError(
                f"--plot must be a folder for {len(tasks)} files (got {out})."
            )
        check_place(out)
        return {tasks[0].number: out}
    is_other = out.suffix.lower() in OTHER_PICTURES and not out.is_dir()
    if is_other or (out.exists() and not out.is_dir()):
        raise InvalidValueError(f"--plot must be a folder or end in .png (got {out}).")
    _check_writable(next(place for place in (out, *out.parents) if place.exists()))
    names = picture_names(tasks)
    return {task.number: out / name for task, name in zip(tasks, names)}


def check_place(path: Path) -> None:
    """Check that a file can be written, before the work is done.

    Raises:
        InvalidValueError: If it cannot.
    """
    if not path.parent.is_dir():
        raise InvalidValueError(
            f"The folder {path.parent} for {path.name} does not exist."
        )
    if path.is_dir():
        raise InvalidValueError(f"{path} is a folder, not a file.")
    _check_writable(path.parent)


def _check_writable(folder: Path) -> None:
    """Check that something can be written into a folder."""
    if not os.access(folder, os.W_OK):
        raise InvalidValueError(f"The folder {folder} is not writable.")


def write_text(name: str, text: str) -> None:
    """Write a text into a file, or on stdout."""
    # File names may contain bytes that are not text.
    data = text.encode("utf-8", "backslashreplace")
    if name == STDOUT:
        sys.stdout.write(data.decode("utf-8"))
        sys.stdout.flush()
    else:
        write_whole(Path(name), data)


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
        found, near = self._by_name.get(_name(executed), []), []
        for path in found:  # folders of the same names, from the files up
            pairs = zip(path.parts[-2::-1], executed.parts[-2::-1])
            near.append(next((n for n, (a, b) in enumerate(pairs) if a != b), 10**6))
        if not found or near.count(max(near)) > 1:
            how = "several motions are" if found else "no motion is"
            return f"{how} called {_name(executed)} in {self._against}"
        return found[near.index(max(near))]


def _name(path: Path) -> str:
    """Name a motion by its file without extension, and its name in the file."""
    file, name = split(path)
    return file.stem if name is None else f"{file.stem}#{name}"


def write_comparisons(
    found: Sequence[tuple[str, Comparison | str]], place: str | None
) -> None:
    """Print one comparison in full, several as a table with a row each.

    Args:
        found: Names of files, and their comparisons or why there is none.
        place: File of a JSON list with an object per file; ``STDOUT``: instead of the
            text; None: there is no JSON.

    Raises:
        InvalidValueError: If it cannot be written.
    """
    if place != STDOUT and len(found) == 1:
        say(f"{found[0][0]}: {found[0][1]}")
    elif place != STDOUT:
        rows = [HEAD, *(_row(name, comparison) for name, comparison in found)]
        say("\n".join(table(rows, 1)))
    if place:
        content = [
            {"file": name, "problem": comparison}
            if isinstance(comparison, str)
            else {"file": name, **comparison.as_dict()}
            for name, comparison in found
        ]
        write_text(place, json.dumps(content, indent=2) + "\n")


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
