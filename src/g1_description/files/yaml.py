"""Reading YAML files of settings."""

from __future__ import annotations

import math
import numbers
from contextlib import suppress
from pathlib import Path

from g1_description.errors import G1DescriptionError, cause

MAX_SIZE = 1_000_000
"""Largest file of settings in bytes."""

MAX_NESTING = 20_000
"""Most levels for the parser in C, which uses its stack for each."""


class YamlError(G1DescriptionError):
    """A YAML file cannot be read."""


def read_yaml(file: Path) -> object:
    """Read the first document of a file.

    Returns:
        Plain Python objects; None if the file has no content.

    Raises:
        YamlError: If it cannot be read; the message has the line, but not the file.
    """
    try:
        with file.open("rb") as stream:
            data = stream.read(MAX_SIZE + 1)
    except OSError as error:
        raise YamlError(f"it cannot be read: {error.strerror}") from error
    if len(data) > MAX_SIZE:
        raise YamlError(f"it is larger than {MAX_SIZE / 1e6:g} MB")
    return parse_yaml(data)


def parse_yaml(data: bytes) -> object:
    """Read the first document of a text in UTF-8.

    Raises:
        YamlError: If it is not valid.
    """
    # Imported late: it takes 40 ms, and most programs read no such file.
    from ruamel.yaml import YAML, YAMLError
    from ruamel.yaml.constructor import DuplicateKeyError

    try:
        text = data.decode("utf-8")
        # In C, twenty times as fast; but lines are unnamed and %YAML is ignored.
        if sum(map(text.count, "[{-?")) < MAX_NESTING and "%YAML" not in text:
            with suppress(YAMLError):
                return YAML(typ="safe").load(text)
        return YAML(typ="safe", pure=True).load(text)
    except (YAMLError, DuplicateKeyError, RecursionError, ValueError) as error:
        raise YamlError(f"it is not valid YAML: {yaml_problem(error)}") from error


def yaml_problem(error: Exception) -> str:
    """Format an error of a YAML parser in one line."""
    mark = getattr(error, "problem_mark", None)
    where = f"line {mark.line + 1}: " if mark else ""
    problem = cause(Exception(getattr(error, "problem", None) or error))
    # The message on a duplicate key also contains both values.
    return where + problem.partition(" with value")[0]


def finite_number(value: object) -> float | None:
    """Return a value as a number; None if it is not a finite one."""
    if isinstance(value, bool) or not isinstance(value, numbers.Real):
        return None
    try:
        number = float(value)
    except OverflowError:
        return None
    return number if math.isfinite(number) else None
