"""Texts on files, printed in the order of the files above a progress bar."""

from __future__ import annotations

import sys
from typing import TextIO

from tqdm import tqdm

from g1_description.command_line import say


class Printer:
    """Prints the text on each file once those on all files before it are printed."""

    def __init__(self, n_files: int, stream: TextIO | None) -> None:
        """Start the progress bar.

        Args:
            n_files: Number of files.
            stream: Where texts are printed; None: nowhere.
        """
        self.stream = stream
        self._waiting: dict[int, str] = {}
        self._next = 0
        is_hidden = n_files < 2 or not sys.stderr.isatty()
        self._bar = tqdm(total=n_files, unit="file", disable=is_hidden)

    def add(self, number: int, text: str) -> None:
        """Add the text on a file; an empty one is not printed."""
        self._waiting[number] = text
        while self._next in self._waiting:
            self._print(self._waiting.pop(self._next))
            self._next += 1
        self._bar.update()

    def close(self) -> None:
        """Print texts that waited for unfinished files."""
        self._bar.close()
        for number in sorted(self._waiting):
            self._print(self._waiting.pop(number))

    def _print(self, text: str) -> None:
        if text and self.stream is not None:
            with tqdm.external_write_mode(self.stream):
                say(text, self.stream)
