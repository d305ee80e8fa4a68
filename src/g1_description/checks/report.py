"""Results of files as tables, JSON and CSV."""

from __future__ import annotations

import csv
import io
import json
import math
from collections import Counter
from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

from g1_description.checks.verdict import (
    COUNTS,
    FAILED,
    FIGURES,
    PASSED,
    WARNING,
    Finding,
    Verdict,
    cause_text,
    worst_of,
)

NOT_READ, NOT_CHECKED = "not read", "not checked"
NO_MOTION = "not a motion"

RESULTS = (PASSED, WARNING, FAILED, NOT_READ, NOT_CHECKED, NO_MOTION)
"""Results of a file."""


@dataclass(frozen=True)
class FileResult:
    """A verdict on the motion of a file, or why there is none."""

    file: str
    """As given on the command line, or as found in a given folder."""

    verdict: Verdict | None = None

    problem: str = ""
    """Why there is no verdict, as a sentence."""

    without_verdict: str = NOT_CHECKED
    """The result where there is no verdict."""

    plot: bytes = b""
    """A picture as PNG; empty if none was requested."""

    scene: str = ""
    """The motion as the page of a report draws it; empty if not requested."""

    picture: str = ""
    """File of the picture, from the folder of the report; empty if there is none."""

    @property
    def result(self) -> str:
        """One of ``RESULTS``."""
        if self.verdict is not None:
            return self.verdict.severity
        return self.without_verdict


def counted(results: Iterable[str]) -> dict[str, int]:
    """Count results: numbers by all of ``RESULTS``."""
    counts = Counter(results)
    return {result: counts[result] for result in RESULTS}


HEAD = ("", "check", "finding", "first at", "% of time")
"""Columns of the table of findings."""


def outcome_text(outcome: FileResult) -> str:
    """Describe the result of a file, in a line or in a table."""
    head = f"{outcome.file}: {outcome.result}"
    verdict = outcome.verdict
    if verdict is None:
        return f"{head}: {outcome.problem}"
    figures = verdict.figures
    if "duration" in figures:
        head += f", {figures['duration']:.2f} s, {figures['samples']:.0f} samples"
    lines = [head]
    if verdict.findings:
        lines += table([HEAD, *map(cause_row, verdict.causes)], 3)
    lines += [f"  excluded by {rule}" for rule in verdict.excluded_by]
    lines += [f"  note: {note}" for note in verdict.notes]
    if verdict.skipped:
        lines.append(f"  skipped: {skipped_text(verdict)}")
    return "\n".join(lines)


def summary_text(outcomes: Sequence[FileResult], not_done: int) -> str:
    """Summarize the results, and the files that are not done."""
    counts = counted(outcome.result for outcome in outcomes)
    words = {WARNING: "with a warning" if counts[WARNING] == 1 else "with warnings"}
    parts = [f"{n} {words.get(word, word)}" for word, n in counts.items() if n]
    files = f"{len(outcomes)} file{'s' if len(outcomes) != 1 else ''}"
    rest = f"; interrupted, {not_done} not done" if not_done else ""
    return f"{files}: {', '.join(parts) or 'nothing done'}{rest}"


def cause_row(findings: Collection[Finding]) -> tuple[str, ...]:
    """Describe the findings of one cause, in the columns of ``HEAD``."""
    worst = worst_of(findings)
    return (
        worst.severity,
        worst.check,
        cause_text(findings),
        f"{min(finding.first_time for finding in findings):.3f} s",
        f"{100.0 * max(f.share for f in findings):.1f}" if worst.unit else "",
    )


def skipped_text(verdict: Verdict) -> str:
    """List the checks that were not made, by their reasons."""
    reasons = dict.fromkeys(verdict.skipped.values())
    return "; ".join(
        f"{', '.join(c for c, why in verdict.skipped.items() if why == reason)} "
        f"({reason})"
        for reason in reasons
    )


def table(rows: Sequence[Sequence[str]], n_left: int) -> list[str]:
    """Align columns.

    Args:
        rows: Cells; all rows have the same length.
        n_left: Number of columns that are aligned to the left; the others to the right.
    """
    widths = [max(map(len, column)) for column in zip(*rows)]

    def aligned(row: Sequence[str]) -> str:
        cells = [
            cell.ljust(width) if number < n_left else cell.rjust(width)
            for number, (cell, width) in enumerate(zip(row, widths))
        ]
        return f"  {'  '.join(cells)}".rstrip()

    return [aligned(row) for row in rows]


FIRST_COLUMNS = (
    *("file", "result", *COUNTS, "first_time", "problem", "excluded_by", "picture"),
    *FIGURES,
)
"""Columns of the CSV, without those of each check."""


def json_text(outcomes: Sequence[FileResult], not_done: int) -> str:
    """Write results as JSON, with the number of files that are not done."""
    content = {
        "interrupted": not_done > 0,
        "not_done": not_done,
        "counts": counted(outcome.result for outcome in outcomes),
        "files": [
            {
                "file": outcome.file,
                "result": outcome.result,
                **({"picture": outcome.picture} if outcome.picture else {}),
                **(outcome.verdict.as_dict() if outcome.verdict else {}),
                **({} if outcome.verdict else {"problem": outcome.problem}),
            }
            for outcome in outcomes
        ],
    }
    return json.dumps(_finite(content), indent=1, allow_nan=False) + "\n"


def _finite(value: Any) -> Any:
    """Replace numbers that JSON does not have: NaN and infinity become None."""
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, dict):
        return {key: _finite(part) for key, part in value.items()}
    if isinstance(value, list):
        return [_finite(part) for part in value]
    return value


def csv_text(outcomes: Sequence[FileResult]) -> str:
    """Write outcomes as CSV; unknown values are empty.

    Lines end with a line feed. A carriage return in a name becomes a space.
    """
    from g1_description.checks.rules import RULES  # motion has no need of them

    text = io.StringIO()
    of_checks = [c for rule in RULES for c in (rule.name, f"{rule.name}_worst")]
    columns = [*FIRST_COLUMNS, *of_checks]
    writer = csv.DictWriter(text, columns, lineterminator="\n")
    writer.writeheader()
    for outcome in outcomes:
        writer.writerow(_row(outcome))
    return text.getvalue().replace("\r", " ")


def _row(outcome: FileResult) -> dict[str, Any]:
    """Return the row of a file."""
    row: dict[str, Any] = {"file": outcome.file, "result": outcome.result}
    row["picture"] = outcome.picture
    verdict = outcome.verdict
    if verdict is None:
        return {**row, "problem": outcome.problem}
    row.update(verdict.counts)
    row["excluded_by"] = "; ".join(verdict.excluded_by)
    if verdict.first_time is not None:
        row["first_time"] = verdict.first_time
    row.update({k: verdict.figures[k] for k in FIGURES if k in verdict.figures})
    row.update(dict.fromkeys(verdict.skipped, "skipped"))
    for check in verdict.checked:
        found = verdict.of(check)
        severities = {finding.severity for finding in found}
        row[check] = next((s for s in (FAILED, WARNING) if s in severities), PASSED)
        if found:
            worst = max(found, key=lambda finding: finding.badness)
            row[f"{check}_worst"] = worst.worst
    return row
