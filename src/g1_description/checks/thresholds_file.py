"""Thresholds from YAML files or mappings."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

from g1_description.checks.rules import RULES
from g1_description.checks.thresholds import (
    SIGNS,
    Exclusion,
    JointBounds,
    Thresholds,
)
from g1_description.checks.verdict import COUNTS, FIGURES, NOTES, WORST
from g1_description.errors import ThresholdError
from g1_description.files.model_files import share_folder
from g1_description.files.yaml import YamlError, finite_number, read_yaml
from g1_description.text import listed, similar_first

DEFAULTS = "config/checks.yaml"
"""The default thresholds, in the package's folder."""

BOUNDS = ("acceleration_bounds", "jerk_bounds")
POSITIVE = ("window", "longest_interval")
"""Parameters that cannot be zero."""

FORMER = {"bearing_height": "support_height", "bearing_speed": "support_speed"}
"""Names of parameters by those of 1.0."""

EXCLUDE = "exclude"
"""The only action of a rule over a figure."""

PARAMETERS = tuple(
    part.name
    for part in fields(Thresholds)
    if part.name not in ("levels", "exclusions")
)


def read_thresholds(file: Path | None = None) -> Thresholds:
    """Read the default thresholds, changed by a YAML file.

    Args:
        file: The file; None: the defaults of ``config/checks.yaml``.

    Raises:
        ThresholdError: If a file cannot be read, or holds something else.
    """
    usual = _changed_by(share_folder() / DEFAULTS, Thresholds())
    return usual if file is None else _changed_by(file, usual)


def _changed_by(path: Path, thresholds: Thresholds) -> Thresholds:
    """Apply the thresholds of a file."""
    try:
        content = read_yaml(path)
    except YamlError as error:
        raise ThresholdError(f"{path}: {error}.") from error
    if not isinstance(content, dict):
        raise ThresholdError(f"{path} must map names of thresholds to their values.")
    try:
        return with_thresholds(thresholds, content)
    except ThresholdError as error:
        raise ThresholdError(f"{path}: {error}") from error


def with_thresholds(thresholds: Thresholds, content: Mapping[str, Any]) -> Thresholds:
    """Change some thresholds.

    Args:
        thresholds: Thresholds to begin with.
        content: Values by name: of a check ``{warning: NUMBER, failure: NUMBER}``, of
            bounds ``{default: NUMBER, joints: {NAME: NUMBER}}``, else a number; in the
            first two null means no limit. ``FIGURE > NUMBER`` or ``FIGURE < NUMBER``
            is a rule, with the value ``exclude``.

    Raises:
        ThresholdError: If a name is unknown or a value is invalid.
    """
    rules = {rule.name: rule for rule in RULES}
    known = [*rules, *PARAMETERS]
    levels = dict(thresholds.levels)
    exclusions = list(thresholds.exclusions)
    changed: dict[str, Any] = {}
    for name, value in content.items():
        if name in rules:
            parts = _parts(name, value, ("warning", "failure"))
            numbers = {k: _optional(f"{name}.{k}", n) for k, n in parts.items()}
            if (
                rules[name].lower_is_worse
                and min(filter(None, numbers.values()), default=0) < 0
            ):
                raise ThresholdError(f"The thresholds of {name} must not be negative.")
            levels[name] = replace(rules[name].level_in(thresholds), **numbers)
        elif any(sign in str(name) for sign in SIGNS):
            exclusions.append(_exclusion(str(name), value))
        elif name not in known:
            raise ThresholdError(
                f"Unknown threshold '{name}'. Known thresholds: "
                f"{listed(similar_first(FORMER.get(name, str(name)), known))}."
            )
        elif name in BOUNDS:
            changed[name] = _bounds(name, value, getattr(thresholds, name))
        else:
            changed[name] = _parameter(name, value)
    exclusions = list(dict.fromkeys(exclusions))
    return replace(thresholds, levels=levels, exclusions=tuple(exclusions), **changed)


def _exclusion(text: str, value: Any) -> Exclusion:
    """Read a rule over a figure."""
    rule = Exclusion.parsed(text)
    if rule is None or not math.isfinite(rule.bound):
        raise ThresholdError(
            f"The rule '{text}' must be FIGURE > NUMBER or FIGURE < NUMBER."
        )
    figures = (*FIGURES, *COUNTS, NOTES, *(rule.name + WORST for rule in RULES))
    if rule.figure not in figures:
        known = listed(similar_first(rule.figure, figures))
        raise ThresholdError(
            f"The rule '{text}' has the unknown figure '{rule.figure}'. Known figures: "
            f"{known}."
        )
    if value != EXCLUDE:
        raise ThresholdError(f"The rule '{text}' must be '{EXCLUDE}' (got {value!r}).")
    return rule


def _bounds(name: str, value: Any, usual: JointBounds) -> JointBounds:
    """Read bounds of joints; a missing default is kept."""
    parts = _parts(name, value, ("default", "joints"))
    joints = parts.get("joints") or {}
    if not isinstance(joints, Mapping):
        raise ThresholdError(
            f"{name}.joints must map joints to numbers (got {joints!r})."
        )
    found = {str(j): _number(f"{name}.joints.{j}", v) for j, v in joints.items()}
    default = _optional(f"{name}.default", parts.get("default", usual.default))
    if any(bound <= 0.0 for bound in (*found.values(), default) if bound is not None):
        raise ThresholdError(f"The bounds in {name} must be positive.")
    return JointBounds(default, found)


def _parameter(name: str, value: Any) -> float:
    """Read a height, speed or time."""
    number = _number(name, value)
    if name != "floor_height" and number < 0.0:
        raise ThresholdError(f"{name} must not be negative (got {value}).")
    if name in POSITIVE and not number > 0.0:
        raise ThresholdError(f"{name} must be greater than 0 (got {value}).")
    return number


def _parts(name: str, value: Any, known: tuple[str, ...]) -> Mapping[str, Any]:
    """Read a mapping with some of the allowed keys."""
    if not isinstance(value, Mapping):
        raise ThresholdError(
            f"{name} must be a mapping with {listed(known)} (got {value!r})."
        )
    for key in value:
        if key not in known:
            raise ThresholdError(
                f"Unknown key '{key}' of {name}. Known keys: "
                f"{listed(similar_first(str(key), known))}."
            )
    return value


def _optional(name: str, value: Any) -> float | None:
    return None if value is None else _number(name, value, " or null")


def _number(name: str, value: Any, more: str = "") -> float:
    """Read a finite number."""
    number = finite_number(value)
    if number is None:
        raise ThresholdError(f"{name} must be a number{more} (got {value!r}).")
    return number
