"""Command lines that answer a mistake with one sentence."""

from __future__ import annotations

import argparse
import math
from collections.abc import Sequence
from contextlib import suppress
from typing import Any, TextIO


class OneSentenceParser(argparse.ArgumentParser):
    """A parser whose errors fit into one line of a launch's output."""

    misuse = 1
    """Exit code where the command line is wrong."""

    def error(self, message: str) -> Any:
        """End with a sentence, without the usage."""
        self.exit(self.misuse, f"{self.prog}: {message}; {self.prog} -h shows more.\n")


class Ignored(argparse.Action):
    """Remember that an option was given which means nothing here.

    It needs ``ignored`` among the parser's defaults.
    """

    def __call__(
        self,
        parser: argparse.ArgumentParser,
        namespace: argparse.Namespace,
        values: str | Sequence[Any] | None,
        option_string: str | None = None,
    ) -> None:
        """Put the option into the list, once."""
        namespace.ignored = [*dict.fromkeys([*namespace.ignored, option_string])]


def say(text: str, stream: TextIO | None = None) -> None:
    """Print a line at once; a terminal that was closed takes none.

    Args:
        text: The line.
        stream: Where to; by default the standard output.
    """
    with suppress(OSError):
        # In one piece: a signal may come between the text and the end of the line.
        print(f"{text}\n", end="", file=stream, flush=True)


def number(text: str) -> float:
    """Read a finite number."""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if math.isfinite(value):
        return value
    raise argparse.ArgumentTypeError(f"'{text.strip()}' is not a number")
