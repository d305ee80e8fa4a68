"""Outcomes for people at a terminal."""

from __future__ import annotations

from collections.abc import Sequence

from g1_description.core.checks.verdict import WARNING, Finding, Verdict

from .outcome import Outcome, counted

HEAD = ("", "check", "joint, link or pair", "worst", "first at", "share of time")


def outcome_text(outcome: Outcome) -> str:
    """Describe what was found of a file, in a line or in a table."""
    head = f"{outcome.file}: {outcome.result}"
    verdict = outcome.verdict
    if verdict is None:
        return f"{head}: {outcome.problem}"
    lines = [f"{head}{_measures(verdict)}"]
    if verdict.findings:
        lines += table([HEAD, *(finding_row(f) for f in verdict.findings)], 3)
    lines += [f"  note: {note}" for note in verdict.notes]
    if verdict.skipped:
        lines.append(f"  skipped: {skipped_text(verdict)}")
    return "\n".join(lines)


def summary_text(outcomes: Sequence[Outcome], not_done: int = 0) -> str:
    """Count the outcomes, in a sentence.

    Args:
        outcomes: Of the files that are done.
        not_done: Number of files that are not.
    """
    counts = counted(outcome.result for outcome in outcomes)
    parts = [f"{n} {_plural(word, n)}" for word, n in counts.items() if n]
    files = f"{len(outcomes)} file{'s' if len(outcomes) != 1 else ''}"
    rest = f"; interrupted, {not_done} not done" if not_done else ""
    return f"{files}: {', '.join(parts) or 'nothing done'}{rest}"


def _plural(result: str, count: int) -> str:
    """Return the word for files with a result."""
    if result == WARNING:
        return "with warnings" if count != 1 else "with a warning"
    return result


def _measures(verdict: Verdict) -> str:
    """Tell how long a motion is."""
    figures = verdict.figures
    if "duration" not in figures:
        return ""
    return f", {figures['duration']:.2f} s, {figures['samples']:.0f} samples"


def finding_row(finding: Finding) -> tuple[str, ...]:
    """Describe a finding: severity, check, subject, size, first time, duration."""
    return (
        finding.severity,
        finding.check,
        finding.name or "the robot",
        f"{finding.worst:.4g} {finding.unit}" if finding.unit else "",
        f"{finding.first_time:.3f} s",
        f"{100.0 * finding.share:.1f} %" if finding.unit else "",
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
        rows: Cells, as many in each.
        n_left: So many columns are aligned to the left, the others to the right.
    """
    widths = [max(map(len, column)) for column in zip(*rows)]

    def aligned(row: Sequence[str]) -> str:
        cells = [
            cell.ljust(width) if number < n_left else cell.rjust(width)
            for number, (cell, width) in enumerate(zip(row, widths))
        ]
        return f"  {'  '.join(cells)}".rstrip()

    return [aligned(row) for row in rows]
