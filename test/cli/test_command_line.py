"""Command lines are read into dataclasses, and what is wrong is told in a line."""

import io
import math
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import List, Optional

import pytest

from g1_description.command_line import (
    Argument,
    argument,
    arguments_of,
    default_text,
    number,
    option,
    parse,
    positive,
    say,
    within,
)
from g1_description.errors import InvalidValueError
from g1_description.libraries import missing


@dataclass(frozen=True)
class Options:
    """What a test wants."""

    file: Path = argument("its file", Path)
    more: str = argument("100 % more", str, nargs="?", default="none")
    speed: float = option("its speed", 2.5)
    how_often: int = option("times", 3, within(1, 9, int), shown="thrice", see="#often")
    up_to: float = option("an end", 4.0, positive(5.0), names=("-u", "--end"))
    quiet: bool = option("say nothing", False)
    only: Optional[List[str]] = option("choose", action="append")
    at_least: Optional[float] = option("a bound", None, within(2.0))
    big: float = option("no bound", 1.0, positive(math.inf))

    def __post_init__(self):
        if self.quiet and self.only:
            raise InvalidValueError("Be quiet or choose.")


def read(*words):
    return parse(Options, "try", words)


def test_values_come_from_words_or_are_defaults():
    assert read("a.csv") == Options(
        Path("a.csv"), "none", 2.5, 3, 4.0, False, None, None, 1.0
    )
    assert read("a.csv") == Options(Path("a.csv"))
    words = "b some --speed 1 --how-often 9 -u 5 --at-least 2.5 --big 1e9 --quiet"
    assert read(*words.split()) == Options(
        Path("b"), "some", 1.0, 9, 5.0, True, None, 2.5, 1e9
    )
    found = read("b", "--end", "1e-9", "--how-often", "1", "--only", "x", "--only", "y")
    assert (found.up_to, found.how_often, found.only) == (1e-9, 1, ["x", "y"])


@pytest.mark.parametrize(
    ("words", "told"),
    [
        ("", "the following arguments are required: file"),
        ("a --speed nan", "argument --speed: must be a number (got 'nan')"),
        ("a --speed x", "argument --speed: must be a number (got 'x')"),
        (
            "a --how-often 0",
            "argument --how-often: must be a whole number from 1 to 9 (got 0)",
        ),
        (
            "a --how-often x",
            "argument --how-often: must be a whole number from 1 to 9 (got x)",
        ),
        (
            "a --at-least 1.9",
            "argument --at-least: must be a number at least 2 (got 1.9)",
        ),
        ("a -u 0", "argument -u/--end: must be greater than 0 and at most 5 (got 0)"),
        (
            "a -u 5.1",
            "argument -u/--end: must be greater than 0 and at most 5 (got 5.1)",
        ),
        ("a --big 0", "argument --big: must be greater than 0 (got 0)"),
        ("a --quiet --only b", "Be quiet or choose"),
        ("a b --x", "unrecognized arguments: --x"),
        ("a --bog 1", "unrecognized arguments: --bog 1 (did you mean --big?)"),
        ("a --onion", "unrecognized arguments: --onion"),
        ("a --quie", "unrecognized arguments: --quie (did you mean --quiet?)"),
        (
            "a --sped=2 --y",
            "unrecognized arguments: --sped=2 --y (did you mean --speed?)",
        ),
    ],
)
def test_what_is_wrong_is_told_in_a_line(words, told, capsys):
    with pytest.raises(SystemExit) as ended:
        read(*words.split())
    assert ended.value.code == 2
    assert capsys.readouterr().err == f"try: {told}; see try -h.\n"


@pytest.mark.parametrize("program", ["try", "g1 try", "g1-description try"])
def test_help_tells_defaults(program, capsys, monkeypatch):
    monkeypatch.setattr(sys, "argv", [f"bin/{program.split()[0]}"])
    with pytest.raises(SystemExit):
        read("-h")
    told = " ".join(capsys.readouterr().out.split())
    assert told.startswith(f"usage: {program} [-h] [--speed SPEED]")
    for text in (
        "What a test wants.",
        "100 % more; default: none",
        "--speed SPEED its speed; default: 2.5 ",
        "times; default: thrice",
        "--quiet say nothing --only ONLY choose --at-least",
    ):
        assert text in told
    assert arguments_of(Options)["how_often"].see == "#often"
    assert default_text(Argument("", False, given={"default": 1e-6})) == "1e-06"
    assert number(" 1 ") == 1.0


def test_a_line_is_said_at_once_and_a_closed_terminal_is_no_error():
    class Stream(io.StringIO):
        is_flushed = False

        def flush(self):
            self.is_flushed = True

    class Closed(Stream):
        def write(self, text):
            raise BrokenPipeError

    stream = Stream()
    say("so", stream)
    assert (stream.getvalue(), stream.is_flushed) == ("so\n", True)
    say("so", Closed())


def test_what_catkin_built_gets_the_versions_of_its_requirements(monkeypatch):
    monkeypatch.setattr(sys, "path", [])  # nothing is installed by pip
    line = missing("web", ModuleNotFoundError(name="viser.uplot"))
    assert line.startswith("web needs viser; install it as docs/install.md says: ")
    assert line.endswith(" -m pip install -r requirements.txt")
