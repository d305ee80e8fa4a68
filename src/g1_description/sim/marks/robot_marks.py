"""What was found of the robot as it is now, drawn beside it."""

from __future__ import annotations

import numpy as np

from g1_description.core.checks.balance import support_polygon
from g1_description.core.checks.limits import units
from g1_description.core.checks.verdict import FAILED, Finding, Verdict
from g1_description.core.robot.assembly import root_in_base
from g1_description.core.robot.description import Description, Joint
from g1_description.core.robot.kinematics import Kinematics
from g1_description.core.transform import IDENTITY, compose
from g1_description.sim.checks.timeline import Timeline

from .canvas import GREEN, ORANGE, RED, Canvas, Color
from .labels import SIZE, Label, places, short_name

ABOVE = 0.004
"""What lies on the floor is drawn so much above it, in [m]."""

UP = np.array([0.0, 0.0, 1.0])

CONTACT, FLOOR = "contacts", "floor"
BALANCE, SUPPORT, LIMITS = "centre of mass", "support polygon", "joint limits"
LABELS = "labels"
"""Namespaces: what one can switch on and off."""

ON_FLOOR = ("penetration", "floating")
"""Checks whose points are links above or below the floor."""


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
        timeline: Timeline,
        verdict: Verdict,
        base: np.ndarray | None,
    ) -> None:
        """Draw all marks.

        Args:
            canvas: What draws, in the map; without a base in the base's own frame.
            timeline: What was measured of one state.
            verdict: What was found of it.
            base: T_map_base, shape (7,); None: that frame is the base's.
        """
        labels = [
            *self._contacts(canvas, verdict),
            *self._near_limits(canvas, timeline, base),
        ]
        labels += self._balance(canvas, timeline, verdict)
        around = places(labels, IDENTITY if base is None else base)
        for label, (begin, middle) in zip(labels, around):
            canvas.line(LABELS, np.stack([label.point, begin]), 0.002, label.color)
            canvas.text(LABELS, middle, label.text, SIZE, label.color)

    def _contacts(self, canvas: Canvas, verdict: Verdict) -> list[Label]:
        """Mark where links touch each other, and where they are in the floor."""
        labels = []
        for finding in verdict.findings:
            if finding.check == "self_collision":
                text = "/".join(short_name(link) for link in finding.subject)
                labels.append(_mark(canvas, CONTACT, finding, text))
            elif finding.check in ON_FLOOR and finding.points:
                where = "in" if finding.check == "penetration" else "above"
                name = short_name(finding.name) or "the robot"
                labels.append(
                    _mark(canvas, FLOOR, finding, f"{name} {where} the floor")
                )
        return labels

    def _near_limits(
        self, canvas: Canvas, timeline: Timeline, base: np.ndarray | None
    ) -> list[Label]:
        """Mark joints that are near their limits, or beyond."""
        rows = np.array([self._row[name] for name in timeline.joint_names], dtype=int)
        positions = np.zeros(len(self._joints))
        positions[rows] = timeline.positions[0]
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
        self, canvas: Canvas, timeline: Timeline, verdict: Verdict
    ) -> list[Label]:
        """Show the centre of mass above what bears."""
        balance = timeline.balance
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
        corners = np.array(support_polygon(timeline.support[0]))
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
        is_judged = "center_of_mass" in verdict.checked
        return RED if is_judged and not np.isnan(margin) else ORANGE


def _mark(canvas: Canvas, namespace: str, finding: Finding, what: str) -> Label:
    """Mark the points of a finding, and name it."""
    points = np.array(finding.points)
    color = RED if finding.severity == FAILED else ORANGE
    for point in points:
        canvas.ball(namespace, point, 0.03, color)
    text = f"{what} {1e3 * finding.worst:.0f} mm"
    return Label(points.mean(axis=0), text, color)
