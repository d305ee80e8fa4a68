"""What check writes: JSON, CSV, pictures and a page."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TextIO

from tqdm import tqdm

from g1_description.checks.batch import Task
from g1_description.checks.report import FileResult, csv_text, json_text, outcome_text
from g1_description.checks.report_page import write_page
from g1_description.cli.check_options import STDOUT
from g1_description.cli.motion_paths import picture_names
from g1_description.command_line import say
from g1_description.errors import InvalidValueError
from g1_description.files.atomic import whole_file, write_whole

PICTURE = ".png"


class Reports:
    """Writes what was asked for; pictures at once, the rest in the end."""

    def __init__(self, args: argparse.Namespace, tasks: Sequence[Task]) -> None:
        """Check that all can be written.

        Args:
            args: Of the command line.
            tasks: The files.

        Raises:
            InvalidValueError: If something cannot.
        """
        self._args = args
        self.problems: list[str] = []
        """Why something that was asked for is not written."""
        self._pictures = _pictures(args.plot, tasks)
        for name in (args.json, args.csv, args.html):
            if name not in (None, STDOUT):
                check_place(Path(name))
        motions = {os.path.realpath(task.path) for task in tasks}
        if args.csv and os.path.realpath(args.csv) in motions:
            raise InvalidValueError(f"--csv {args.csv} is a motion to check.")
        # A page has all pictures in the end; until then they need no memory.
        self._kept = TemporaryDirectory(prefix="check_") if args.html else None

    def add(self, task: Task, outcome: FileResult) -> None:
        """Write the picture of a file."""
        if outcome.plot and task.number in self._pictures:
            with self._going_on():
                write_whole(self._pictures[task.number], outcome.plot)
        if outcome.plot and self._kept:
            Path(self._kept.name, str(task.number)).write_bytes(outcome.plot)

    def write(self, outcomes: Mapping[int, FileResult], not_done: int) -> None:
        """Write the rest.

        Args:
            outcomes: By the number of the file.
            not_done: Number of files that are not done.
        """
        found = [outcomes[number] for number in sorted(outcomes)]
        if self._args.json:
            with self._going_on():
                _write(self._args.json, json_text(found, not_done))
        if self._args.csv:
            with self._going_on():
                _write(self._args.csv, csv_text(found))
        if self._args.html:
            with self._going_on(), whole_file(self._args.html) as part:
                pictures = [self._picture(number) for number in sorted(outcomes)]
                write_page(part, found, pictures, not_done)

    @contextmanager
    def _going_on(self) -> Iterator[None]:
        """Take note of what cannot be written, and go on with the rest."""
        try:
            yield
        except InvalidValueError as error:
            self.problems.append(str(error))

    def _picture(self, number: int) -> Path | None:
        """Return where the picture of a file was kept; None if it has none."""
        assert self._kept is not None
        path = Path(self._kept.name, str(number))
        return path if path.exists() else None


def _pictures(out: Path | None, tasks: Sequence[Task]) -> dict[int, Path]:
    """Decide where pictures are written, by the numbers of the files."""
    if out is None:
        return {}
    if out.suffix.lower() == PICTURE and not out.is_dir():
        if len(tasks) > 1:
            raise InvalidValueError(
                f"--plot {out} is one picture for {len(tasks)} files: name a folder."
            )
        check_place(out)
        return {tasks[0].number: out}
    if out.exists() and not out.is_dir():
        raise InvalidValueError(f"--plot {out} is neither a folder nor a .png.")
    _check_writable(next(place for place in (out, *out.parents) if place.exists()))
    names = picture_names(tasks)
    return {task.number: out / name for task, name in zip(tasks, names)}


def check_place(path: Path) -> None:
    """Check that a file can be written, before the work is done.

    Raises:
        InvalidValueError: If it cannot.
    """
    if not path.parent.is_dir():
        raise InvalidValueError(f"There is no folder {path.parent} for {path.name}.")
    if path.is_dir():
        raise InvalidValueError(f"{path} is a folder.")
    _check_writable(path.parent)


def _check_writable(folder: Path) -> None:
    """Check that something can be written into a folder."""
    if not os.access(folder, os.W_OK):
        raise InvalidValueError(f"Nothing can be written into {folder}.")


def _write(name: str, text: str) -> None:
    """Write a text into a file, or on stdout."""
    # Names of files may hold bytes that are no text.
    data = text.encode("utf-8", "backslashreplace")
    if name == STDOUT:
        sys.stdout.write(data.decode("utf-8"))
        sys.stdout.flush()
    else:
        write_whole(Path(name), data)


class Results:
    """Collects outcomes; shows each as soon as all before it are there."""

    def __init__(self, n_files: int, stream: TextIO | None) -> None:
        """Show that nothing is done yet.

        Args:
            n_files: Number of files.
            stream: Where tables are printed; None: nowhere.
        """
        self.outcomes: dict[int, FileResult] = {}
        """By the number of the file."""
        self._n_files, self._stream, self._next = n_files, stream, 0
        self._bar = tqdm(total=n_files, unit="file", disable=not _is_shown(n_files))

    def add(self, task: Task, outcome: FileResult) -> None:
        """Add the outcome of a file."""
        self.outcomes[task.number] = outcome
        while self._next in self.outcomes:
            self._show(self._next)
            self._next += 1
        self._bar.update()

    def close(self) -> None:
        """Show those that waited for others, which are not done."""
        self._bar.close()
        for number in sorted(self.outcomes):
            if number > self._next:
                self._show(number)

    @property
    def n_missing(self) -> int:
        """Number of files that are not done."""
        return self._n_files - len(self.outcomes)

    def _show(self, number: int) -> None:
        """Print the table of a file."""
        if self._stream is not None:
            with tqdm.external_write_mode(self._stream):
                say(outcome_text(self.outcomes[number]), self._stream)


def _is_shown(n_files: int) -> bool:
    """Return whether somebody looks, and there is something to wait for."""
    return n_files > 1 and sys.stderr.isatty()
