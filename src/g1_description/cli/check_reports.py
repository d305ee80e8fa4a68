"""Reports of the command check: where they go, and their writing."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory

from g1_description.checks.batch import Task
from g1_description.checks.report import (
    COLUMNS,
    NOT_READ,
    FileResult,
    csv_text,
    json_text,
)
from g1_description.cli.motion_paths import picture_names
from g1_description.errors import InvalidValueError
from g1_description.files.atomic import whole_file, write_whole
from g1_description.motion.selection import EXCLUDE, UNDECIDED, Choice, Selection
from g1_description.render.page import write_page
from g1_description.robot.description import Description

STDOUT = "-"

PICTURE = ".png"

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
    begin = ",".join(COLUMNS[:2]).encode()
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
        self, outcomes: Mapping[int, FileResult], not_done: int, robot: Description
    ) -> None:
        """Write the rest.

        Args:
            outcomes: By the number of the file.
            not_done: Number of files that are not done.
            robot: The robot that the page draws.
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
                write_page(part, robot, found, motions, not_done)
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
            reasons = _reasons(outcome) if outcome else ()
            chosen = selection.of(task.path)
            if reasons and chosen.choice == UNDECIDED:
                notes = (chosen.note, *reasons)
                note = "; ".join(filter(None, notes))
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


def _reasons(outcome: FileResult) -> tuple[str, ...]:
    """Return why a motion is excluded."""
    if outcome.result == NOT_READ:
        return (f"not read: {outcome.problem}",)
    return outcome.verdict.excluded_by if outcome.verdict else ()


def _pictures(out: Path | None, tasks: Sequence[Task]) -> dict[int, Path]:
    """Return the paths of pictures by number of the file."""
    if out is None:
        return {}
    if out.suffix.lower() == PICTURE and not out.is_dir():
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
