"""Outcomes for other programs: JSON, and CSV with a row per file."""

from __future__ import annotations

import csv
import io
import json
import math
from collections.abc import Sequence
from typing import Any

from g1_description.core.checks.thresholds import LEVELS
from g1_description.core.checks.verdict import FAILED, PASSED, WARNING, Verdict

from .outcome import Outcome, counted

FIGURES = (
    "duration",
    "samples",
    "samples_beyond_limits",
    "largest_joint_speed",
    "deepest_self_collision",
    "lowest_height",
    "least_center_margin",
    "least_zmp_margin",
    "fall_time",
    "rms_tracking_error",
    "largest_tracking_error",
)
"""Figures of a motion that have a column."""

COLUMNS = (
    *("file", "result", "failed", "warnings", "first_time", "problem"),
    *FIGURES,
    *(column for check in LEVELS for column in (check, f"{check}_worst")),
)
"""Columns of the CSV."""


def json_text(outcomes: Sequence[Outcome], not_done: int = 0) -> str:
    """Write outcomes as JSON.

    Args:
        outcomes: Of the files that are done.
        not_done: Number of files that were left out, as the work was interrupted.
    """
    content = {
        "interrupted": not_done > 0,
        "not_done": not_done,
        "counts": counted(outcome.result for outcome in outcomes),
        "files": [_as_dict(outcome) for outcome in outcomes],
    }
    return json.dumps(_finite(content), indent=1, allow_nan=False) + "\n"


def _as_dict(outcome: Outcome) -> dict[str, Any]:
    """Return an outcome for JSON."""
    found: dict[str, Any] = {"file": outcome.file, "result": outcome.result}
    if outcome.verdict is None:
        return {**found, "problem": outcome.problem}
    return {**found, **outcome.verdict.as_dict()}


def _finite(value: Any) -> Any:
    """Replace what JSON has no number for, such as a share of a limit of zero."""
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, dict):
        return {key: _finite(part) for key, part in value.items()}
    if isinstance(value, list):
        return [_finite(part) for part in value]
    return value


def csv_text(outcomes: Sequence[Outcome]) -> str:
    """Write outcomes as CSV; what is not known is empty.

    Lines end as Unix has it. A carriage return in a name, which would end one, too,
    becomes a space.
    """
    text = io.StringIO()
    writer = csv.DictWriter(text, COLUMNS, lineterminator="\n")
    writer.writeheader()
    for outcome in outcomes:
        writer.writerow(_row(outcome))
    return text.getvalue().replace("\r", " ")


def _row(outcome: Outcome) -> dict[str, Any]:
    """Return the row of a file."""
    row: dict[str, Any] = {"file": outcome.file, "result": outcome.result}
    verdict = outcome.verdict
    if verdict is None:
        return {**row, "problem": outcome.problem}
    severities = [finding.severity for finding in verdict.findings]
    row["failed"], row["warnings"] = map(severities.count, (FAILED, WARNING))
    if verdict.first_time is not None:
        row["first_time"] = verdict.first_time
    row.update({k: verdict.figures[k] for k in FIGURES if k in verdict.figures})
    for check in LEVELS:
        row.update(_cells(verdict, check))
    return row


def _cells(verdict: Verdict, check: str) -> dict[str, Any]:
    """Return what one check says: its result, and the largest fault."""
    if check not in verdict.checked:
        return {check: "skipped"} if check in verdict.skipped else {}
    found = verdict.of(check)
    if not found:
        return {check: PASSED}
    severity = FAILED if FAILED in {f.severity for f in found} else WARNING
    return {check: severity, f"{check}_worst": max(f.worst for f in found)}
