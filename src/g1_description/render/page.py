"""A page in three dimensions: a robot, its motions and their findings, in one file.

It is opened from disk and requests nothing: its policy forbids that. The texts are
there without JavaScript; scripts draw the robot, the time line and plots.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from html import escape
from pathlib import Path

import numpy as np

from g1_description.checks.report import FileResult, skipped_text, summary_text
from g1_description.checks.rule import units
from g1_description.checks.verdict import (
    Finding,
    Verdict,
    cause_text,
    figure_text,
    worst_of,
)
from g1_description.motion.motion import Motion, fitted
from g1_description.render.page_data import motion_data, robot_data
from g1_description.robot.description import Description
from g1_description.scenes.objects import SceneObject

BROWSER = Path(__file__).with_name("browser")
SCRIPTS = ("motion.js", "scene.js", "chart.js", "viewer.js")
"""Folder of the style and the scripts, and those in the order in which they are run."""

POLICY = "default-src 'none'; style-src 'unsafe-inline'; script-src 'unsafe-inline'"
"""Content-Security-Policy: the page loads nothing."""

COLUMNS = {
    "duration": "length [s]",
    "root_path": "path [m]",
    "root_speed.max": "base [m/s]",
    "joint_speed.max": "joints [rad/s]",
    "contact_share": "contact",
    "energy": "energy [J]",
}
"""Figures in the table of files."""


def motion_page(
    description: Description,
    motion: Motion,
    verdict: Verdict | None = None,
    name: str = "",
    scene: Mapping[str, SceneObject] | None = None,
    before: Motion | None = None,
    about: str = "",
) -> str:
    """Write a page on a motion.

    Args:
        description: The robot.
        motion: The motion; a configuration is a motion of one sample. Joints that the
            robot does not have are ignored.
        verdict: Its verdict, with its measurements for their plots; None: it was not
            checked.
        name: Name of the motion; empty: its own name, or that of the robot.
        scene: Objects around the robot; None: none.
        before: What the motion was before it was changed, drawn beside it; None: the
            motion alone is drawn.
        about: Lines of text on the motion.

    Returns:
        HTML. Names may contain bytes that are not text, so it is to be encoded with
        the error handler ``backslashreplace``.

    Raises:
        MotionError: If the robot has none of the motion's joints.
    """
    motion = fitted(motion, description)
    title = name or motion.name or description.name
    objects = [*(scene or {}).values()]
    robot, notes = robot_data(description, objects)
    table = ""
    if len(motion.times) == 1:
        unit = {joint.name: units(joint)[0] for joint in description.movable_joints}
        rows = [
            _row("td", (escape(name), f"{position:.4f} {unit[name]}"))
            for name, position in zip(motion.joint_names, motion.positions[0].tolist())
        ]
        table = f'<table class="joints">\n{"".join(rows)}</table>\n'
    if about:
        table = f'<pre class="about">{escape(about)}</pre>\n{table}'
    if before is not None:
        before = fitted(before, description)
    content = motion_data(description, motion, verdict, objects, before)
    section = _section(FileResult(title, verdict), 0, content, notes, table)
    return "".join(_page(title, "", section, robot))


def write_page(
    path: Path,
    description: Description,
    outcomes: Sequence[FileResult],
    motions: Sequence[Path],
    not_done: int,
    objects: Collection[SceneObject] = (),
) -> None:
    """Write a page on checked motions.

    Args:
        path: The file.
        description: The robot.
        outcomes: Outcomes of the files that are done.
        motions: Files with ``motion_data`` of each outcome, missing if it could not be
            read. All may not fit into memory, so they are embedded one after another.
        not_done: Number of files that are not done.
        objects: Those around the robot, as ``motion_data`` had them.

    Raises:
        OSError: If it cannot be written.
    """
    is_drawn = any(motion.is_file() for motion in motions)
    robot, notes = robot_data(description, objects) if is_drawn else ("", ())
    is_single = len(outcomes) == 1 and not not_done
    title = outcomes[0].file if is_single else "Checks of motions"
    overview = "" if is_single else "".join(_overview(outcomes, not_done))
    sections = (
        part
        for number, (outcome, motion) in enumerate(zip(outcomes, motions))
        for part in _section(
            outcome,
            number,
            motion.read_text() if motion.is_file() else "",
            notes,
            is_one=is_single,
        )
    )
    # File names may contain bytes that are not text.
    with path.open("w", encoding="utf-8", errors="backslashreplace") as file:
        file.writelines(_page(title, overview, sections, robot))


def _page(
    title: str, overview: str, sections: Iterable[str], robot: str
) -> Iterator[str]:
    """Write the parts of a page."""
    yield (
        '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        f'<meta http-equiv="Content-Security-Policy" content="{POLICY}">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>{escape(title)}</title>\n"
        f"<style>\n{_read('style.css')}</style>\n</head>\n<body>\n{overview}"
    )
    yield from sections
    yield (
        f'<script type="application/json" id="robot">{robot or "null"}</script>\n'
        f"<script>\n{''.join(map(_read, SCRIPTS))}</script>\n</body>\n</html>\n"
    )


def _read(name: str) -> str:
    """Read a file of the page."""
    return (BROWSER / name).read_text(encoding="utf-8")


def _overview(outcomes: Sequence[FileResult], not_done: int) -> Iterator[str]:
    """Write the table of all files."""
    heads = ("file", "result", "failures", "warnings", "first at", *COLUMNS.values())
    last = "checks that failed; excluded by"
    yield (
        '<div id="overview">\n<h1>Checks of motions</h1>\n'
        f"<p>{escape(summary_text(outcomes, not_done))}.</p>\n"
        f'<table class="files">\n{_row("th", (*heads, last))}'
    )
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
    yield "</table>\n</div>\n"


BACK = '<a class="back" href="#">◂ All files</a>\n'


def _section(
    outcome: FileResult,
    number: int,
    motion: str,
    notes: Sequence[str],
    table: str = "",
    is_one: bool = True,
) -> Iterator[str]:
    """Write the section of a file: its texts, and its motion as JSON."""
    verdict = outcome.verdict
    badge = _badge(outcome.result) if verdict or outcome.problem else ""
    n_causes = len(verdict.causes) if verdict else 0
    more = f"{n_causes} finding{'s' if n_causes > 1 else ''}" if n_causes else ""
    yield (
        f'<section class="file" id="file{number}">\n{"" if is_one else BACK}'
        f'<h2 data-more="{more}">{escape(outcome.file)} {badge}</h2>\n<div>\n'
    )
    if outcome.problem:
        yield f"<p>{escape(outcome.problem)}</p>\n"
    if verdict is not None:
        yield from _verdict(verdict)
    for note in notes:
        yield f'<p class="about">not drawn: {escape(note)}</p>\n'
    yield f"{table}</div>\n"
    if motion:
        yield f'<script type="application/json">{motion}</script>\n'
    yield "</section>\n"


def _verdict(verdict: Verdict) -> Iterator[str]:
    """Write a verdict, with a button for the findings of each cause."""
    if verdict.findings:
        yield '<div class="findings">\n'
        for findings in verdict.causes:
            worst = worst_of(findings)
            yield (
                f'<button class="{worst.severity}">'
                f"<b>{escape(worst.check.replace('_', ' '))}</b> "
                f"<small>{escape(_times(findings))}</small><br>"
                f"{escape(cause_text(findings))}</button>\n"
            )
        yield "</div>\n"
    figures = ", ".join(figure_text(*figure) for figure in verdict.figures.items())
    yield f'<p class="about">{escape(verdict.robot)}: {escape(figures)}</p>\n'
    for rule in verdict.excluded_by:
        yield f'<p class="about">excluded by {escape(rule)}</p>\n'
    for note in verdict.notes:
        yield f'<p class="about">{escape(note)}</p>\n'
    if verdict.skipped:
        yield f'<p class="about">skipped: {escape(skipped_text(verdict))}</p>\n'


def _times(findings: Sequence[Finding]) -> str:
    """Say when the findings of a cause are, and which threshold the worst exceeds."""
    worst = worst_of(findings)
    parts = [f"{worst.severity} from {min(f.first_time for f in findings):.3f} s"]
    if worst.unit:
        parts.append(f"{100.0 * max(f.share for f in findings):.1f} % of the time")
    if worst.bound and np.isfinite(worst.bound):
        parts.append(f"threshold {worst.bound:.4g} {worst.unit}".rstrip())
    return ", ".join(parts)


def _badge(result: str) -> str:
    """Write a result in its colour."""
    return f'<span class="result {result.split()[0]}">{result}</span>'


def _row(tag: str, cells: Sequence[str]) -> str:
    """Write a row of a table, of cells in HTML."""
    return f"<tr>{''.join(f'<{tag}>{cell}</{tag}>' for cell in cells)}</tr>\n"
