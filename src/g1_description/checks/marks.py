"""What was found of the robot as it is now, drawn beside it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol, Tuple

import numpy as np

from g1_description.checks.balance import support_polygon
from g1_description.checks.measured import Measured
from g1_description.checks.rule import Rule, units
from g1_description.checks.rules import RULES
from g1_description.checks.verdict import FAILED, Finding, Verdict
from g1_description.robot.assembly import root_in_base
from g1_description.robot.description import Description, Joint
from g1_description.robot.kinematics import Kinematics
from g1_description.robot.rotation import rotate
from g1_description.robot.transform import IDENTITY, compose

Color = Tuple[float, float, float]
"""Red, green, blue, from 0 to 1."""

RED, ORANGE, GREEN = (0.85, 0.05, 0.05), (0.95, 0.5, 0.0), (0.1, 0.6, 0.2)


class Canvas(Protocol):
    """Takes one mark after the other; a namespace can be switched on and off."""

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
        """Add a text of a height in [m] that faces whoever looks."""


SIZE = 0.03
"""Height of the texts, in [m]."""

WIDTH = 0.5
"""Of a character, as a share of its height."""

REACH = 0.36
"""How far beside the middle of the robot texts begin, in [m]."""

SPACING = 1.4
"""Least difference in height of texts on one side of the robot, in heights."""


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
    """Find places for texts: to the left or right of the robot, one above the other.

    Args:
        labels: The texts.
        base: Pose of the robot's root link, shape (7,).

    Returns:
        Where each begins, and its middle, in [m], shapes (3,).
    """
    left = rotate(base[3:], np.array([0.0, 1.0, 0.0]))
    left[2] = 0.0
    left /= max(float(np.linalg.norm(left)), 1e-6)
    sides = [float((label.point - base[:3]) @ left) >= 0.0 for label in labels]
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
    """Leave out what ends the names of most links or joints."""
    for ending in ("_link", "_joint"):
        if name.endswith(ending):
            return name[: -len(ending)]
    return name


ABOVE = 0.004
"""What lies on the floor is drawn so much above it, in [m]."""

UP = np.array([0.0, 0.0, 1.0])

BALANCE, SUPPORT, LIMITS = "centre of mass", "support polygon", "joint limits"
LABELS = "labels"
"""Namespaces of what is drawn beside the findings, which can be switched on and off."""


def red_links(verdict: Verdict) -> set[str]:
    """Return the links that are drawn in red, as those that collide."""
    reddens = {rule.name for rule in RULES if rule.reddens}
    found = (f.subject for f in verdict.findings if f.check in reddens)
    return {link for subject in found for link in subject}


class RobotMarks:
    """Draws the marks of one robot."""

    def __init__(self, robot: Description, floor: float, limit_margin: float) -> None:
        """Prepare.

        Args:
            robot: The robot.
            floor: Height of the floor in the map, in [m].
            limit_margin: Joints this near to a limit are marked, in [rad] or [m]; of
                joints with a small range a tenth of it.
        """
        self._floor = floor + ABOVE
        self._joints = robot.movable_joints
        self._row = {joint.name: row for row, joint in enumerate(self._joints)}
        self._lower = np.array([joint.lower for joint in self._joints])
        self._upper = np.array([joint.upper for joint in self._joints])
        ranges = np.maximum(self._upper - self._lower, 0.0)
        self._margin = np.minimum(limit_margin, 0.1 * ranges)
        self._kinematics = Kinematics(robot)
        self._T_base_root = root_in_base(robot)

    def draw(
        self,
        canvas: Canvas,
        verdict: Verdict,
        base: np.ndarray | None,
    ) -> None:
        """Draw all marks.

        Args:
            canvas: What draws, in the map; without a base in the base's own frame.
            verdict: What was found and measured of one state.
            base: T_map_base, shape (7,); None: that frame is the base's.
        """
        measured = verdict.measured
        assert measured is not None
        rules = {rule.name: rule for rule in RULES if rule.namespace}
        labels = [
            _mark(canvas, rules[finding.check], finding)
            for finding in verdict.findings
            if finding.check in rules and finding.points
        ]
        labels += self._near_limits(canvas, measured, base)
        labels += self._balance(canvas, measured, verdict)
        around = places(labels, IDENTITY if base is None else base)
        for label, (begin, middle) in zip(labels, around):
            canvas.line(LABELS, np.stack([label.point, begin]), 0.002, label.color)
            canvas.text(LABELS, middle, label.text, SIZE, label.color)

    def _near_limits(
        self, canvas: Canvas, measured: Measured, base: np.ndarray | None
    ) -> list[Label]:
        """Mark joints that are near their limits, or beyond."""
        rows = np.array([self._row[name] for name in measured.joint_names], dtype=int)
        positions = np.zeros(len(self._joints))
        positions[rows] = measured.positions[0]
        room = np.minimum(positions - self._lower, self._upper - positions)[rows]
        near = rows[np.flatnonzero(room < self._margin[rows])]
        if not near.size:
            return []
        pose = IDENTITY if base is None else base
        root = compose(pose, self._T_base_root)
        origins = self._kinematics.place(root, positions)[1]
        labels = [
            self._limit_label(self._joints[row], positions[row], origins[row])
            for row in near.tolist()
        ]
        for label in labels:
            canvas.ball(LIMITS, label.point, 0.13, label.color, 0.45)
        return labels

    @staticmethod
    def _limit_label(joint: Joint, position: float, origin: np.ndarray) -> Label:
        """Say how far a joint is from its nearer limit, or beyond."""
        above, below = joint.upper - position, position - joint.lower
        room, bound = min((above, "upper"), (below, "lower"))
        color, word = (RED, "beyond") if room < 0.0 else (ORANGE, "to")
        text = f"{abs(room):.3f} {units(joint)[0]} {word} {bound} limit"
        return Label(origin, f"{short_name(joint.name)} {text}", color)

    def _balance(
        self, canvas: Canvas, measured: Measured, verdict: Verdict
    ) -> list[Label]:
        """Show the centre of mass above the support polygon."""
        balance = measured.balance
        if balance is None:
            return []
        center, margin = balance.center[0], float(balance.center_margin[0])
        color = self._balance_color(margin, verdict)
        below = np.append(center[:2], self._floor)
        canvas.ball(BALANCE, center, 0.07, color)
        canvas.line(BALANCE, np.stack([center, below]), 0.006, color)
        canvas.disc(BALANCE, below + 0.001 * UP, 0.05, color)
        if np.isnan(margin):
            return []
        corners = np.array(support_polygon(measured.support[0]))
        polygon = np.column_stack([corners, np.full(len(corners), self._floor)])
        canvas.line(SUPPORT, np.concatenate([polygon, polygon[:1]]), 0.01, color)
        if len(polygon) > 2:
            fan = [polygon[[0, k, k + 1]] for k in range(1, len(polygon) - 1)]
            canvas.triangles(SUPPORT, np.concatenate(fan), color, 0.25)
        side = "inside" if margin >= 0.0 else "outside"
        text = f"centre of mass {1e3 * abs(margin):.0f} mm {side}"
        return [Label(below, text, color)]

    @staticmethod
    def _balance_color(margin: float, verdict: Verdict) -> Color:
        """Choose green inside, red outside, orange where that is no fault."""
        if margin >= 0.0:
            return GREEN
        is_checked = "center_of_mass" in verdict.checked
        return RED if is_checked and not np.isnan(margin) else ORANGE


def _mark(canvas: Canvas, rule: Rule, finding: Finding) -> Label:
    """Mark the points of a finding, and name it."""
    points = np.array(finding.points)
    color = RED if finding.severity == FAILED else ORANGE
    for point in points:
        canvas.ball(rule.namespace, point, 0.03, color)
    subject = "/".join(short_name(name) for name in finding.subject) or "the robot"
    size = f"{finding.worst:.3g} {finding.unit}"
    if finding.unit == "m":
        size = f"{1e3 * finding.worst:.0f} mm"
    text = f"{rule.label.format(subject=subject)} {size}"
    return Label(points.mean(axis=0), text, color)
