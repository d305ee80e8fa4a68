"""Markers of the findings of a robot's current state."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol, Tuple

import numpy as np

from g1_description.checks.measured import Measured
from g1_description.checks.rule import units
from g1_description.checks.rules import RULES
from g1_description.checks.support import support_polygon
from g1_description.checks.verdict import FAILED, Finding, Verdict
from g1_description.robot.rotation import rotate
from g1_description.robot.transform import IDENTITY, compose

Color = Tuple[float, float, float]
"""Red, green, blue, from 0 to 1."""

RED, ORANGE, GREEN = (0.85, 0.05, 0.05), (0.95, 0.5, 0.0), (0.1, 0.6, 0.2)


class Canvas(Protocol):
    """Draws marks; each namespace can be switched on and off."""

    def ball(
        self,
        namespace: str,
        center: np.ndarray,
        size: float,
        color: Color,
        alpha: float = 1.0,
    ) -> None:
        """Add a ball with a diameter in [m] about a point, shape (3,)."""

    def disc(
        self, namespace: str, center: np.ndarray, size: float, color: Color
    ) -> None:
        """Add a flat disc on the floor, with a diameter in [m]."""

    def line(
        self, namespace: str, points: np.ndarray, width: float, color: Color
    ) -> None:
        """Add a line through points, shape (n, 3), of a width in [m]."""

    def triangles(
        self, namespace: str, corners: np.ndarray, color: Color, alpha: float
    ) -> None:
        """Add triangles with corners of shape (3 n, 3)."""

    def text(
        self, namespace: str, place: np.ndarray, text: str, size: float, color: Color
    ) -> None:
        """Add a text of a height in [m] that always faces the viewer."""


SIZE = 0.03
"""Height of the texts, in [m]."""

WIDTH = 0.5
"""Width of a character as a fraction of its height."""

REACH = 0.36
"""Distance of texts from the centre of the robot, in [m]."""

SPACING = 1.4
"""Least spacing of texts on one side of the robot, in text heights."""


@dataclass(frozen=True, eq=False)
class Label:
    """A text about a point of the robot."""

    point: np.ndarray
    """In [m], shape (3,)."""

    text: str
    color: Color


def places(
    labels: Sequence[Label], base: np.ndarray
) -> list[tuple[np.ndarray, np.ndarray]]:
    """Place texts to the left or right of the robot, one above the other.

    Args:
        labels: The texts.
        base: Pose of the robot's root link, shape (7,).

    Returns:
        Start and centre of each text, in [m], shapes (3,).
    """
    left = rotate(base[3:], np.array([0.0, 1.0, 0.0]))
    left[2] = 0.0
    left /= max(float(np.linalg.norm(left)), 1e-6)
    sides = [float((label.point - base[:3]) @ left) >= -ROUNDING for label in labels]
    heights = np.array([float(label.point[2]) for label in labels])
    for side in (False, True):
        rows = [row for row in np.argsort(heights) if sides[row] == side]
        for lower, row in zip(rows, rows[1:]):
            heights[row] = max(heights[row], heights[lower] + SPACING * SIZE)
    found = []
    for label, side, height in zip(labels, sides, heights):
        away = left[:2] if side else -left[:2]
        half = 0.5 * WIDTH * SIZE * len(label.text)
        begin, middle = base[:2] + REACH * away, base[:2] + (REACH + half) * away
        found.append((np.append(begin, height), np.append(middle, height)))
    return found


def short_name(name: str) -> str:
    """Remove the usual suffixes of names of links and joints."""
    for ending in ("_link", "_joint"):
        if name.endswith(ending):
            return name[: -len(ending)]
    return name


def subject_text(finding: Finding) -> str:
    """Name the subject of a finding in short; "the robot" if it has none."""
    return "/".join(map(short_name, finding.subject)) or "the robot"


def size_text(finding: Finding) -> str:
    """Format the worst size of a finding."""
    if finding.unit == "m":
        return f"{1e3 * finding.worst:.0f} mm"
    return f"{finding.worst:.3g} {finding.unit}".rstrip()


ABOVE = 0.004
"""Height above the floor of marks on it, in [m]."""

ROUNDING = 1e-9
"""What is no more than rounding, in [rad] or [m]."""

BALANCE, SUPPORT, LIMITS = "centre of mass", "support polygon", "joint limits"
LABELS = "labels"
"""Namespaces of the marks other than findings."""


def red_links(verdict: Verdict) -> set[str]:
    """Return the links to draw in red, such as those in collision."""
    reddens = {rule.name for rule in RULES if rule.reddens}
    found = (f.subject for f in verdict.findings if f.check in reddens)
    return {link for subject in found for link in subject}


def draw_marks(canvas: Canvas, verdict: Verdict, limit_margin: float) -> None:
    """Draw all marks of one state.

    Args:
        canvas: In the map frame, or in that of the base if the state has no base.
        verdict: With its measurements.
        limit_margin: Joints this near to a limit are marked, in [rad] or [m]; of
            joints with a small range a tenth of it.
    """
    measured = verdict.measured
    assert measured is not None
    poses = measured.motion.base_poses
    base = IDENTITY if poses is None else poses[0]
    rules = {rule.name: rule for rule in RULES if rule.namespace}
    labels = []
    for finding in verdict.findings:
        rule, points = rules.get(finding.check), np.array(finding.points)
        if rule is None or not len(points):
            continue
        color = RED if finding.severity == FAILED else ORANGE
        for point in points:
            canvas.ball(rule.namespace, point, 0.03, color)
        about = rule.label.format(subject=subject_text(finding))
        text = f"{about} {size_text(finding)}"
        labels.append(Label(points.mean(axis=0), text, color))
    labels += _near_limits(canvas, measured, base, limit_margin)
    labels += _balance(canvas, measured, verdict)
    write_labels(canvas, LABELS, labels, base)


def write_labels(
    canvas: Canvas, namespace: str, labels: Sequence[Label], base: np.ndarray
) -> None:
    """Write texts next to a robot with this base, each with a line to its point."""
    for label, (begin, middle) in zip(labels, places(labels, base)):
        canvas.line(namespace, np.stack([label.point, begin]), 0.002, label.color)
        canvas.text(namespace, middle, label.text, SIZE, label.color)


def _near_limits(
    canvas: Canvas, measured: Measured, base: np.ndarray, limit_margin: float
) -> list[Label]:
    """Mark joints near or beyond their limits."""
    near = {}
    for joint, position in zip(measured.joints, measured.positions[0].tolist()):
        above, below = joint.upper - position, position - joint.lower
        room, bound = min((above, "upper"), (below, "lower"))
        if room < min(limit_margin, 0.1 * max(joint.upper - joint.lower, 0.0)):
            room = 0.0 if abs(room) < ROUNDING else room
            word = "beyond" if room < 0.0 else "to"
            text = f"{abs(room):.3f} {units(joint)[0]} {word} {bound} limit"
            color = RED if room < 0.0 else ORANGE
            near[joint.name] = f"{short_name(joint.name)} {text}", color
    if not near:
        return []
    robot = measured.robot
    positions = measured.at(measured.times[:1])[1][0]
    root = compose(base, robot.T_base_root)
    placed = zip(robot.joints, robot.kinematics.place(root, positions)[1])
    origins = {joint.name: origin for joint, origin in placed}
    labels = [Label(origins[name], text, color) for name, (text, color) in near.items()]
    for label in labels:
        canvas.ball(LIMITS, label.point, 0.13, label.color, 0.45)
    return labels


def _balance(canvas: Canvas, measured: Measured, verdict: Verdict) -> list[Label]:
    """Show the centre of mass above the support polygon.

    Green inside, red outside, orange if the check is skipped.
    """
    balance = measured.balance
    if balance is None:
        return []
    center, margin = balance.center[0], float(balance.center_margin[0])
    is_checked = "center_of_mass" in verdict.checked
    color = RED if is_checked and margin < 0.0 else ORANGE
    color = GREEN if margin >= 0.0 else color
    floor = float(np.ravel(measured.floor)[0]) + ABOVE
    below = np.append(center[:2], floor)
    canvas.ball(BALANCE, center, 0.07, color)
    canvas.line(BALANCE, np.stack([center, below]), 0.006, color)
    canvas.disc(BALANCE, np.append(center[:2], floor + 0.001), 0.05, color)
    if np.isnan(margin):
        return []
    corners = np.array(support_polygon(measured.support[0]))
    polygon = np.column_stack([corners, np.full(len(corners), floor)])
    canvas.line(SUPPORT, np.concatenate([polygon, polygon[:1]]), 0.01, color)
    if len(polygon) > 2:
        fan = [polygon[[0, k, k + 1]] for k in range(1, len(polygon) - 1)]
        canvas.triangles(SUPPORT, np.concatenate(fan), color, 0.25)
    side = "inside" if margin >= 0.0 else "outside"
    text = f"centre of mass {1e3 * abs(margin):.0f} mm {side}"
    return [Label(below, text, color)]
