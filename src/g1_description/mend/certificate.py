"""Certificates: findings before and after, and how far everything moved."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from g1_description.checks.measured import CheckedRobot, Measured
from g1_description.checks.report import table
from g1_description.checks.rules import RULES
from g1_description.checks.verdict import FAILED, Verdict
from g1_description.motion.motion import Motion
from g1_description.robot.rotation import angle_between

LOW_IS_WORSE = frozenset(rule.name for rule in RULES if rule.lower_is_worse)
"""Checks whose findings are the worse, the smaller they are."""


@dataclass(frozen=True)
class Row:
    """The findings of one check."""

    check: str
    failures: tuple[int, int]
    """Before and after."""

    warnings: tuple[int, int]
    worst: tuple[float, float]
    """Sizes of the worst findings; NaN without one."""

    unit: str


@dataclass(frozen=True)
class Moved:
    """How far a part of the robot was moved."""

    name: str
    rms: float
    largest: float
    time: float
    """When it was the largest, in [s]."""

    unit: str


@dataclass(frozen=True)
class Certificate:
    """A mended motion in comparison with the one before."""

    rows: tuple[Row, ...]
    """Checks with findings before or after."""

    moved: tuple[Moved, ...]
    """Empty if nothing was changed."""

    left: tuple[str, ...]
    """Sentences on what was not mended, and why."""

    falls: tuple[float | None, float | None] | None = None
    """When the simulated robot falls before and after, in [s], or None; None: it was
    not simulated."""

    @property
    def failures(self) -> tuple[int, int]:
        """Numbers of failures before and after."""
        counts = [row.failures for row in self.rows]
        return sum(a for a, _ in counts), sum(b for _, b in counts)

    def as_dict(self) -> dict[str, Any]:
        """Return it for JSON."""
        return {
            "findings": {
                row.check: {
                    "failures": list(row.failures),
                    "warnings": list(row.warnings),
                    "worst": [None if np.isnan(x) else x for x in row.worst],
                    "unit": row.unit,
                }
                for row in self.rows
            },
            "moved": [vars(one) for one in self.moved],
            "left": list(self.left),
            **({"falls": list(self.falls)} if self.falls else {}),
        }

    def __str__(self) -> str:
        """Write both tables, and what was left."""
        if not self.moved:
            lines = ["  nothing is changed."]
        else:
            head = ("check", "failures", "warnings", "worst")
            lines = table([head, *map(_cells, self.rows)], len(head))
            head = ("moved", "rms", "largest", "when")
            cells = [head, *map(_moved_cells, self.moved)]
            lines += ["", *table(cells, len(head))]
        if self.falls:
            before, after = map(_fall_text, self.falls)
            lines.append(f"  simulated: {before} before, {after} after.")
        return "\n".join([*lines, *(f"  left: {text}" for text in self.left)])


def _fall_text(time: float | None) -> str:
    """Say when a robot falls."""
    return "no fall" if time is None else f"a fall at {time:.2f} s"


def _cells(row: Row) -> tuple[str, ...]:
    """Write the cells of a check."""
    sizes = ["-" if np.isnan(size) else f"{size:.4g}" for size in row.worst]
    pairs = (row.failures, row.warnings, sizes)
    return (
        row.check,
        *(f"{a} -> {b}" for a, b in pairs[:2]),
        f"{sizes[0]} -> {sizes[1]} {row.unit}".rstrip(),
    )


def _moved_cells(one: Moved) -> tuple[str, ...]:
    """Write the cells of a moved part."""
    return (
        one.name,
        f"{one.rms:.4f} {one.unit}",
        f"{one.largest:.4f} {one.unit}",
        f"{one.time:.2f} s",
    )


def rows_of(before: Verdict, after: Verdict) -> tuple[Row, ...]:
    """Compare the findings of two verdicts by check."""
    found = {
        finding.check: finding.unit for finding in (*before.findings, *after.findings)
    }
    rows = []
    for check, unit in found.items():
        pair = [[f for f in v.findings if f.check == check] for v in (before, after)]
        failed = [sum(f.severity == FAILED for f in some) for some in pair]
        most = min if check in LOW_IS_WORSE else max
        worst = [most((f.worst for f in some), default=np.nan) for some in pair]
        rows.append(
            Row(
                check,
                (failed[0], failed[1]),
                (len(pair[0]) - failed[0], len(pair[1]) - failed[1]),
                (worst[0], worst[1]),
                unit,
            )
        )
    return tuple(rows)


def moved_parts(
    robot: CheckedRobot, before: Motion, after: Motion
) -> tuple[Moved, ...]:
    """Measure how far joints, base, and ends of limbs moved; none: empty."""
    times = before.times
    joints = np.abs(after.positions - before.positions)
    sliding = [j.name for j in robot.joints if j.kind == "prismatic"]
    slides = np.isin(before.joint_names, sliding)
    found = [
        _moved(name, joints[:, columns], times, unit)
        for name, columns, unit in (
            ("joints", ~slides, "rad"),
            ("sliding joints", slides, "m"),
        )
        if columns.any()
    ]
    if before.base_poses is not None and after.base_poses is not None:
        away = np.linalg.norm((after.base_poses - before.base_poses)[:, :3], axis=1)
        rotations = angle_between(before.base_poses[:, 3:], after.base_poses[:, 3:])
        found.append(_moved("base", away[:, np.newaxis], times, "m"))
        found.append(_moved("base's rotation", rotations[:, np.newaxis], times, "rad"))
    poses = []
    for motion in (before, after):
        measured = Measured(robot, motion)
        base, positions = measured.at(motion.times)[:2]
        poses.append(robot.kinematics.link_poses(base, positions))
    for row in robot.kinematics.limb_ends():
        away = np.linalg.norm((poses[1] - poses[0])[:, row, :3], axis=1)
        found.append(_moved(robot.links[row], away[:, np.newaxis], times, "m"))
    return tuple(found) if any(one.largest > 0.0 for one in found) else ()


def _moved(name: str, sizes: np.ndarray, times: np.ndarray, unit: str) -> Moved:
    """Summarize distances, shape (n, k)."""
    row = int(sizes.max(axis=1).argmax())
    rms = float(np.sqrt((sizes**2).mean()))
    return Moved(name, rms, float(sizes.max()), float(times[row]), unit)
