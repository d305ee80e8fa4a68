"""A self-contained HTML page with all results."""

from __future__ import annotations

import base64
from collections.abc import Iterator, Sequence
from html import escape
from pathlib import Path

from g1_description.checks.causes import cause_text
from g1_description.checks.report import (
    HEAD,
    FileResult,
    cause_row,
    skipped_text,
    summary_text,
)
from g1_description.checks.verdict import Verdict, figure_text

STYLE = """
body { font: 15px/1.45 system-ui, sans-serif; color: #222; margin: 2em auto;
  max-width: 100em; padding: 0 1.5em; }
h1 { font-size: 1.5em; } h2 { font-size: 1.15em; margin: 2.2em 0 .4em; }
table { border-collapse: collapse; margin: .6em 0; }
th, td { text-align: left; padding: .22em .9em .22em 0; border-bottom: 1px solid #ddd;
  vertical-align: top; }
th { color: #666; font-weight: 600; }
td { font-variant-numeric: tabular-nums; }
.files td + td:not(:last-child) { white-space: nowrap; }
.files { display: block; overflow-x: auto; }
.result { padding: .05em .5em; border-radius: .3em; white-space: nowrap; }
.passed { background: #bfe5d8; } .warning { background: #f7e9a0; }
.failed { background: #f0bf99; } .not { background: #ddd; }
.about { color: #555; margin: .2em 0; } img { max-width: 100%; }
a { color: #0060a0; }
.moments { display: flex; flex-wrap: wrap; gap: 1em; }
figure { margin: .4em 0; max-width: 300px; }
figcaption { font-size: .87em; color: #444; overflow-wrap: anywhere; }
.files th { cursor: pointer; white-space: nowrap; }
"""

SCRIPT = """
const cells = (row, n) => row.cells[n].textContent;
document.querySelectorAll(".files th").forEach((head, n) => {
  let sign = -1;
  head.onclick = () => {
    const body = head.closest("table").tBodies[0];
    const rows = [...body.rows].slice(1);
    sign = -sign;
    const number = (row) => parseFloat(cells(row, n));
    rows.sort((a, b) => {
      const [x, y] = [number(a), number(b)];
      if (n > 1 && isNaN(x) !== isNaN(y)) return isNaN(x) ? 1 : -1;
      if (n > 1 && !isNaN(x)) return sign * (x - y);
      return sign * cells(a, n).localeCompare(cells(b, n));
    });
    body.append(...rows);
  };
});
"""
"""Sorts the table of files by a column, also in the other direction; numbers from the
third column on, unknown ones last."""

COLUMNS = {
    "duration": "length [s]",
    "root_path": "path [m]",
    "root_speed.max": "base [m/s]",
    "joint_speed.max": "joints [rad/s]",
    "contact_share": "contact",
    "energy": "energy [J]",
}
"""Figures in the table of files."""


def write_page(
    path: Path,
    outcomes: Sequence[FileResult],
    pictures: Sequence[Sequence[Path]],
    not_done: int,
) -> None:
    """Write a page.

    Args:
        path: The file.
        outcomes: Of the files that are done.
        pictures: PNG files of each outcome: its plot, which may be empty, and those of
            its causes. They are embedded one after another: all may not fit into
            memory.
        not_done: Number of files that are not done.

    Raises:
        OSError: If it cannot be written.
    """
    # File names may contain bytes that are not text.
    with path.open("w", encoding="utf-8", errors="backslashreplace") as file:
        file.writelines(_page(outcomes, pictures, not_done))


def _page(
    outcomes: Sequence[FileResult], pictures: Sequence[Sequence[Path]], not_done: int
) -> Iterator[str]:
    """Write the parts of a page."""
    yield (
        '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>Checks of motions</title>\n<style>{STYLE}</style>\n</head>\n<body>\n"
        f"<h1>Checks of motions</h1>\n<p>{escape(summary_text(outcomes, not_done))}."
        "</p>\n"
    )
    yield from _overview(outcomes)
    for number, (outcome, files) in enumerate(zip(outcomes, pictures)):
        yield from _section(number, outcome, files)
    yield f"<script>{SCRIPT}</script>\n</body>\n</html>\n"


def _overview(outcomes: Sequence[FileResult]) -> Iterator[str]:
    """Write the table of all files."""
    heads = ("file", "result", "failures", "warnings", "first at", *COLUMNS.values())
    last = "checks that failed; excluded by"
    yield f'<table class="files">\n{_row("th", (*heads, last))}'
    for number, outcome in enumerate(outcomes):
        cells = [f'<a href="#file{number}">{escape(outcome.file)}</a>']
        cells.append(_badge(outcome.result))
        if outcome.verdict is None:
            unknown = [""] * (len(heads) - len(cells))
            yield _row("td", [*cells, *unknown, escape(outcome.problem)])
            continue
        findings = outcome.verdict.findings
        time = outcome.verdict.first_time
        first = "" if time is None else f"{time:.3f} s"
        names = dict.fromkeys(f.check for f in findings if f.severity == "failed")
        cells += [*map(str, outcome.verdict.counts.values()), first]
        figures = outcome.verdict.figures
        cells += [f"{figures[n]:.4g}" if n in figures else "" for n in COLUMNS]
        reasons = [", ".join(names), *outcome.verdict.excluded_by]
        yield _row("td", [*cells, escape("; ".join(filter(None, reasons)))])
    yield "</table>\n"


def _section(
    number: int, outcome: FileResult, pictures: Sequence[Path]
) -> Iterator[str]:
    """Write the section of a file."""
    yield (
        f'<h2 id="file{number}">{escape(outcome.file)} {_badge(outcome.result)}</h2>\n'
    )
    if outcome.verdict is None:
        yield f"<p>{escape(outcome.problem)}</p>\n"
        return
    plot, moments = next(iter(pictures), None), pictures[1:]
    yield from _verdict(outcome.verdict)
    if moments:
        yield '<div class="moments">\n'
        for findings, file in zip(outcome.verdict.causes, moments):
            text = escape(cause_text(findings))
            caption = f"<figcaption>{text}</figcaption>"
            yield f"<figure>{_image(file, text)}{caption}</figure>\n"
        yield "</div>\n"
    if plot is not None and plot.stat().st_size:
        yield f"{_image(plot, f'{escape(outcome.file)} over time')}\n"


def _image(file: Path, text: str) -> str:
    """Embed a PNG."""
    data = base64.b64encode(file.read_bytes()).decode("ascii")
    return f'<img alt="{text}" src="data:image/png;base64,{data}">'


def _verdict(verdict: Verdict) -> Iterator[str]:
    """Write a verdict."""
    figures = ", ".join(figure_text(*figure) for figure in verdict.figures.items())
    yield f'<p class="about">{escape(verdict.robot)}: {escape(figures)}</p>\n'
    if verdict.findings:
        yield f"<table>\n{_row('th', HEAD)}"
        for findings in verdict.causes:
            severity, *cells = cause_row(findings)
            yield _row("td", [_badge(severity), *map(escape, cells)])
        yield "</table>\n"
    for rule in verdict.excluded_by:
        yield f'<p class="about">excluded by {escape(rule)}</p>\n'
    for note in verdict.notes:
        yield f'<p class="about">{escape(note)}</p>\n'
    if verdict.skipped:
        yield f'<p class="about">skipped: {escape(skipped_text(verdict))}</p>\n'


def _badge(result: str) -> str:
    """Write a result in its colour."""
    return f'<span class="result {result.split()[0]}">{result}</span>'


def _row(tag: str, cells: Sequence[str]) -> str:
    """Write a row of a table, of cells in HTML."""
    return f"<tr>{''.join(f'<{tag}>{cell}</{tag}>' for cell in cells)}</tr>\n"
