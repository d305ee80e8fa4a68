"""Command lines declared as dataclasses."""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any, Callable, NoReturn, TextIO, TypeVar

from g1_description.errors import G1DescriptionError, InvalidValueError
from g1_description.libraries import missing
from g1_description.text import did_you_mean

Options = TypeVar("Options")

MAX_FPS = 1e6
"""Largest number of samples per second of a motion."""


EXIT_ERROR = 2
"""Exit code where a command line is wrong, or a command cannot do its work."""

DISPATCHERS = ("g1", "g1-description")
"""Programs that take the name of a command first."""

FORMER = {"to": "until"}
"""Names of options by those of 1.0."""


class OneSentenceParser(argparse.ArgumentParser):
    """A parser with errors in one line, as in the output of roslaunch."""

    def __init__(self, **given: Any) -> None:
        # An abbreviation may become ambiguous with the next version.
        super().__init__(allow_abbrev=False, **given)

    def parse_args(self, args: Any = None, namespace: Any = None) -> Any:
        """Parse; end with a sentence about unknown words, with a likely name."""
        given, unknown = self.parse_known_args(args, namespace)
        if unknown:
            names = (name for action in self._actions for name in action.option_strings)
            known = {name.lstrip("-"): name for name in names}
            word = unknown[0].partition("=")[0].lstrip("-")
            hint = did_you_mean(FORMER.get(word, word), known, known)
            self.error(f"unrecognized arguments: {' '.join(unknown)}{hint}")
        return given

    def _check_value(self, action: argparse.Action, value: Any) -> None:
        """Raise an error about a value that is no choice, with a likely one."""
        try:
            super()._check_value(action, value)
        except argparse.ArgumentError as error:
            error.message += did_you_mean(str(value), map(str, action.choices or ()))
            raise

    def error(self, message: str) -> Any:
        """End with a sentence, without the usage."""
        self.exit(EXIT_ERROR, f"{self.prog}: {message}; see {self.prog} -h.\n")


class Ignored(argparse.Action):
    """Record an option without effect.

    The parser must have a default for ``ignored``.
    """

    def __call__(
        self,
        parser: argparse.ArgumentParser,
        namespace: argparse.Namespace,
        values: str | Sequence[Any] | None,
        option_string: str | None = None,
    ) -> None:
        """Add the option to the list, once."""
        namespace.ignored = [*dict.fromkeys([*namespace.ignored, option_string])]


@dataclass(frozen=True)
class Argument:
    """The command-line argument of a field of a command's dataclass."""

    about: str
    """Description, for ``--help`` and the row of the command's page."""

    is_positional: bool

    names: tuple[str, ...] = ()
    """Option strings; empty: ``--`` and the field's name."""

    shown: str = ""
    """Description of the default; empty: the default itself."""

    see: str = ""
    """A link for the row of the page, in Markdown."""

    given: dict[str, Any] = field(default_factory=dict)
    """Further arguments of ``ArgumentParser.add_argument``."""

    def flags(self, name: str) -> tuple[str, ...]:
        """Return the names on the command line for a field's name."""
        if self.is_positional:
            return (name,)
        return self.names or (f"--{name.replace('_', '-')}",)


def option(
    about: str,
    default: Any = None,
    type: Callable[[str], Any] | None = None,
    *,
    names: Sequence[str] = (),
    shown: str = "",
    see: str = "",
    **given: Any,
) -> Any:
    """Declare an option as a field of a command's dataclass.

    Args:
        about: Description in a line.
        default: Its default; False: it is a flag.
        type: Parses its value; by default the type of ``default``.
        names: Its names, if different from the field's.
        shown: Description of the default.
        see: A link for the row of the page, in Markdown.
        given: Further arguments of ``ArgumentParser.add_argument``.
    """
    if default is False:
        given["action"] = "store_true"
    elif given.get("action") != "append" or type:
        given["type"] = type or default.__class__
        if given["type"] is float:
            given["type"] = number
    given["default"] = default
    declared = Argument(about, False, tuple(names), shown, see, given)
    return field(default=default, metadata={"argument": declared})


def argument(
    about: str, type: Callable[[str], Any], shown: str = "", **given: Any
) -> Any:
    """Declare a positional argument, such as a file."""
    given["type"] = type
    declared = Argument(about, True, shown=shown, given=given)
    if "default" in given:
        return field(default=given["default"], metadata={"argument": declared})
    return field(metadata={"argument": declared})


def arguments_of(options: type[Any]) -> dict[str, Argument]:
    """Return the arguments of a command's dataclass by field."""
    return {known.name: known.metadata["argument"] for known in fields(options)}


def program_name(command: str = "") -> str:
    """Return how a command is entered: ``g1 check``, or ``check`` after rosrun."""
    own = Path(sys.argv[0]).stem
    return f"{own if own in DISPATCHERS else ''} {command}".strip()


def parser(options: type[Any], command: str) -> OneSentenceParser:
    """Make a parser from a command's dataclass; its docstring is the description.

    Args:
        options: The dataclass.
        command: Name of the command.
    """
    made = OneSentenceParser(prog=program_name(command), description=options.__doc__)
    for name, declared in arguments_of(options).items():
        given = dict(declared.given)
        if not declared.is_positional:
            given["dest"] = name
        default = default_text(declared)
        text = f"{declared.about}; default: {default}" if default else declared.about
        made.add_argument(*declared.flags(name), help=text.replace("%", "%%"), **given)
    return made


def default_text(declared: Argument) -> str:
    """Return the description of a default; may be empty."""
    default = declared.given.get("default")
    if declared.shown or default is False or default in (None, "", ()):
        return declared.shown
    return f"{default:g}" if isinstance(default, float) else str(default)


def parse(
    options: type[Options],
    command: str,
    words: Sequence[str] | None = None,
) -> Options:
    """Parse a command line; exit with a message if it is wrong.

    Args:
        options: The command's dataclass. Its ``__post_init__`` raises InvalidValueError
            for options that cannot be combined.
        command: Name of the command.
        words: The command line; by default the program's own.
    """
    reader = parser(options, command)
    given = vars(reader.parse_args(words))
    try:
        return options(**given)
    except InvalidValueError as error:
        reader.error(str(error).rstrip("."))
        raise


def exit_with_error(
    command: str, error: G1DescriptionError | OSError | ModuleNotFoundError
) -> NoReturn:
    """Print why a command cannot do its work, and exit.

    Raises:
        BrokenPipeError: If it is one, as before ``| head``.
    """
    if isinstance(error, BrokenPipeError):
        raise error
    text = f"{command}: {error}"
    if isinstance(error, OSError):
        text = f"{command}: {error.filename or 'output'}: {error.strerror or error}."
    elif isinstance(error, ModuleNotFoundError):
        text = missing(command, error)
    say(text, sys.stderr)
    sys.exit(EXIT_ERROR)


def own_arguments() -> list[str]:
    """Return this program's arguments without ROS' remappings."""
    return [word for word in sys.argv[1:] if ":=" not in word]


def say(text: str, stream: TextIO | None = None) -> None:
    """Print and flush a line; errors of a closed terminal are ignored.

    Args:
        text: The line.
        stream: By default the standard output.
    """
    with suppress(OSError):
        # With the end of the line: a signal may come between two writes.
        print(f"{text}\n", end="", file=stream, flush=True)


def number(text: str) -> float:
    """Read a finite number."""
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if math.isfinite(value):
        return value
    raise argparse.ArgumentTypeError(f"must be a number (got '{text.strip()}')")


def within(
    low: float, high: float = math.inf, kind: Callable[[str], Any] = number
) -> Callable[[str], Any]:
    """Return a parser of numbers from ``low`` to ``high``, both included."""
    ends = [f"{end:g}" if isinstance(end, float) else str(end) for end in (low, high)]
    words = f"from {ends[0]} to {ends[1]}" if high < math.inf else f"at least {ends[0]}"

    def read(text: str) -> Any:
        try:
            value = kind(text)
        except ValueError:
            value = math.nan
        if low <= value <= high:
            return value
        noun = "a whole number" if kind is int else "a number"
        raise argparse.ArgumentTypeError(f"must be {noun} {words} (got {text.strip()})")

    return read


def positive(high: float) -> Callable[[str], float]:
    """Return a parser of numbers greater than 0 and at most ``high``."""

    def read(text: str) -> float:
        value = number(text)
        if 0.0 < value <= high:
            return value
        most = f" and at most {high:g}" if high < math.inf else ""
        raise argparse.ArgumentTypeError(
            f"must be greater than 0{most} (got {text.strip()})"
        )

    return read
