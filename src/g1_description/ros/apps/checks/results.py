"""Outcomes as they come, shown in the order of the files."""

from __future__ import annotations

import sys
from typing import TextIO

from tqdm import tqdm

from g1_description.core.cli import say
from g1_description.core.reports.outcome import Outcome
from g1_description.core.reports.text import outcome_text
from g1_description.sim.batch.in_turn import Task


class Results:
    """Collects outcomes; shows each as soon as all before it are there."""

    def __init__(self, n_files: int, stream: TextIO | None) -> None:
        """Show that nothing is done yet.

        Args:
            n_files: Number of files.
            stream: Where tables are printed; None: nowhere.
        """
        self.outcomes: dict[int, Outcome] = {}
        """By the number of the file."""
        self._n_files, self._stream, self._next = n_files, stream, 0
        self._bar = tqdm(total=n_files, unit="file", disable=not _is_shown(n_files))

    def add(self, task: Task, outcome: Outcome) -> None:
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
