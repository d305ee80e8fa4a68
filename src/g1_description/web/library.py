"""The motions of a folder, with their rows of a report and of a selection."""

from __future__ import annotations

import csv
import gc
import json
import math
import os
import re
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path, PurePath
from typing import Any, TextIO

from g1_description.checks.report import NO_MOTION, RESULTS
from g1_description.checks.rules import RULES
from g1_description.checks.verdict import COUNTS, FAILED, FIGURES, WARNING, Verdict
from g1_description.errors import InvalidValueError
from g1_description.motion.selection import (
    CHOICES,
    EXCLUDE,
    KEEP,
    OTHERS,
    UNDECIDED,
    Choice,
    Selection,
)

REPORTS = ("report.csv", "report.json")
"""Usual names of the report, in the folder of the motions."""

UNKNOWN = "not checked yet"
"""Result of a motion that is not in the report."""

ALL = "all"
RESULT_FILTERS = (ALL, *RESULTS, UNKNOWN)
CHECK_FILTERS = (ALL, *(rule.name for rule in RULES))
BY_RULE = "excluded by rule"
CHOICE_FILTERS = (ALL, *CHOICES, BY_RULE)
SORTS = ("name", "result", *FIGURES)


@dataclass(eq=False)
class Entry:
    """A motion of the folder."""

    name: str
    """Its path from the folder."""

    path: Path
    result: str = UNKNOWN
    figures: dict[str, float] = field(default_factory=dict)
    """Some of ``FIGURES`` and ``COUNTS``."""

    found: dict[str, str] = field(default_factory=dict)
    """Worst severity by check, of those that found something."""

    excluded_by: str = ""
    """Rules that exclude it."""

    picture: Path | None = None

    def learn(self, verdict: Verdict) -> None:
        """Take the result of a check."""
        self.result = verdict.severity
        self.figures = {**verdict.figures, **verdict.counts}
        self.excluded_by = "; ".join(verdict.excluded_by)
        # The failed ones are first.
        findings = reversed(verdict.findings)
        self.found = {finding.check: finding.severity for finding in findings}


@dataclass(frozen=True)
class View:
    """Which motions are listed, and in which order."""

    text: str = ""
    """Part of the name."""

    result: str = ALL
    check: str = ALL
    """Only those in which this check found something."""

    choice: str = ALL
    sort: str = "name"
    is_reversed: bool = False


class Library:
    """The motions of a folder."""

    def __init__(
        self,
        folder: Path,
        files: Iterable[Path],
        report: Path | None = None,
        selection: Path | None = None,
    ) -> None:
        """Read the report and the selection.

        Args:
            folder: The folder.
            files: The motions below it.
            report: CSV or JSON as written by ``check``; None: without.
            selection: Its file, which need not exist.

        Raises:
            InvalidValueError: If one cannot be read.
        """
        usual = (folder / name for name in REPORTS)
        own = {os.path.realpath(f) for f in (report, selection, *usual) if f}
        entries = {
            path.relative_to(folder).as_posix(): path
            for path in files
            if os.path.realpath(path) not in own
        }
        found = {name: Entry(name, path) for name, path in entries.items()}
        if report is not None:
            _read_report(report, folder, found)
        self.folder = folder
        in_order = sorted(found.values(), key=lambda entry: entry.path.parts)
        self.entries = [one for one in in_order if one.result != NO_MOTION]
        """In the order of their paths."""
        self.selection = Selection(selection or folder / "selection.yaml", False)

    def listed(self, view: View) -> list[Entry]:
        """Return the motions of a view; those without its figure are last."""
        shown = [entry for entry in self.entries if self._is_in(entry, view)]
        if view.sort == "name":
            return shown[::-1] if view.is_reversed else shown
        if view.sort == "result":
            order = {result: number for number, result in enumerate(RESULT_FILTERS)}
            shown.sort(key=lambda e: order[e.result], reverse=view.is_reversed)
            return shown
        sign = -1.0 if view.is_reversed else 1.0
        figure = view.sort
        shown.sort(key=lambda e: sign * e.figures.get(figure, sign * math.inf))
        return shown

    def _is_in(self, entry: Entry, view: View) -> bool:
        """Return whether a view has a motion."""
        chosen = view.choice == ALL or view.choice == self.choice(entry)
        return (
            chosen
            and view.result in (ALL, entry.result)
            and (view.check == ALL or view.check in entry.found)
            and view.text.lower() in entry.name.lower()
        )

    def choice(self, entry: Entry) -> str:
        """Return one of ``CHOICE_FILTERS``: a person's choice, or that of a rule."""
        chosen = self.selection.of(entry.path).choice
        if chosen == UNDECIDED and not self.selection.keeps(entry.path):
            return EXCLUDE  # as all others
        is_by_rule = chosen == UNDECIDED and entry.excluded_by
        return BY_RULE if is_by_rule else chosen

    def note(self, entry: Entry) -> str:
        """Return the note of a motion."""
        return self.selection.of(entry.path).note

    def choose(
        self, entry: Entry, choice: str | None = None, note: str | None = None
    ) -> None:
        """Write a choice or a note into the file, which may have changed meanwhile.

        Raises:
            InvalidValueError: If it cannot be read or written.
        """
        selection = Selection(self.selection.path, must_exist=False)
        chosen = selection.of(entry.path)
        if choice is not None:
            chosen = replace(chosen, choice=choice)
        if note is not None:
            chosen = replace(chosen, note=note)
        selection.choose(entry.path, chosen)
        selection.write()
        self.selection = selection

    def counts(self) -> tuple[int, int]:
        """Return how many motions the selection keeps and excludes, by their names."""
        choices = dict(self.selection.choices)
        others = choices.pop(OTHERS, Choice())
        chosen = Counter(found.choice for found in choices.values())
        if others.choice == EXCLUDE:
            return chosen[KEEP], max(0, len(self.entries) - chosen[KEEP])
        return chosen[KEEP], chosen[EXCLUDE]


NO_REPORT = "{} is not a report of check --csv or --json."

NOT_AS_WRITTEN = (
    *(csv.Error, ValueError, LookupError, TypeError, AttributeError, RecursionError),
)
"""Errors of reading something else."""


def _json_rows(file: TextIO) -> list[dict[str, Any]]:
    """Read a report with all findings, and leave what its table has."""
    was_enabled = gc.isenabled()
    gc.disable()  # it would take twice the time of the rest
    try:
        files = json.load(file)["files"]
    finally:
        if was_enabled:
            gc.enable()
    rows = []
    for content in files:
        findings = content.get("findings", ())
        severities = [finding["severity"] for finding in findings]
        row = {name: content.get(name) for name in ("file", "result", "picture")}
        row.update(content.get("figures", {}))
        row.update(zip(COUNTS, map(severities.count, (FAILED, WARNING))))
        row["excluded_by"] = "; ".join(content.get("excluded_by", ()))
        # The failed ones are first.
        row.update((f["check"], f["severity"]) for f in reversed(findings))
        rows.append(row)
    return rows


def _read_report(path: Path, folder: Path, entries: dict[str, Entry]) -> None:
    """Give motions their rows of a report.

    A file of several motions becomes the motions that the report has of it.
    """
    several = set()
    try:
        with path.open(encoding="utf-8", newline="") as file:
            is_json = path.suffix.lower() == ".json"
            rows = _json_rows(file) if is_json else list(csv.DictReader(file))
        files = [PurePath(row["file"]).parts for row in rows]
        prefix = _prefix(files, folder, entries)
        for row, parts in zip(rows, files):
            name = "/".join(parts[len(prefix) :])
            file_name = _file_of(name, entries)
            if file_name is None or parts[: len(prefix)] != prefix:
                continue
            if name != file_name:
                motion = Path(f"{entries[file_name].path}{name[len(file_name) :]}")
                entries[name] = Entry(name, motion)
                several.add(file_name)
            _fill(entries[name], row, path)
        for name in several:
            del entries[name]
    except OSError as error:
        raise InvalidValueError(f"{path} cannot be read: {error.strerror}.") from error
    except NOT_AS_WRITTEN as error:
        raise InvalidValueError(NO_REPORT.format(path)) from error


def _file_of(name: str, entries: Mapping[str, Entry]) -> str | None:
    """Return the name of the file of ``NAME`` or ``NAME#MOTION``, if it is there."""
    ends = [len(name), *(mark.start() for mark in re.finditer("#", name))]
    return next((name[:end] for end in ends if name[:end] in entries), None)


def _prefix(
    files: Sequence[tuple[str, ...]], folder: Path, entries: Mapping[str, Entry]
) -> tuple[str, ...]:
    """Find the name of the folder when the files were checked."""
    counts: Counter[tuple[str, ...]] = Counter(
        parts[:n]
        for parts in files
        for n in range(len(parts))
        if _file_of("/".join(parts[n:]), entries) is not None
    )
    name = folder.resolve().name
    return max(counts, key=lambda p: (counts[p], p[-1:] == (name,)), default=())


def _fill(entry: Entry, row: Mapping[str, Any], report: Path) -> None:
    """Take a row of a report."""
    result = row["result"]
    entry.result = result if result in RESULTS else UNKNOWN
    entry.excluded_by = row.get("excluded_by") or ""
    if row.get("picture"):
        entry.picture = report.parent / row["picture"]
    for name in (*FIGURES, *COUNTS):
        if row.get(name) not in (None, ""):
            entry.figures[name] = _number(row[name])
    for rule in RULES:
        if row.get(rule.name) in (FAILED, WARNING):
            entry.found[rule.name] = row[rule.name]


def _number(given: Any) -> float:
    """Read a figure; NaN would spoil the order."""
    try:
        value = float(given)
    except (ValueError, OverflowError):
        return math.inf
    return math.inf if math.isnan(value) else value
