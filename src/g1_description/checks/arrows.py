"""Contact forces as arrows, for the page, reports, RViz and pictures alike."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from g1_description.checks.checker import Checker
from g1_description.checks.marks import RED, Canvas, Color, Label, write_labels
from g1_description.checks.rules.forces import CONTACT_FORCES, forces
from g1_description.checks.verdict import Verdict
from g1_description.errors import MotionError
from g1_description.motion.motion import Motion, sample
from g1_description.robot.description import Description
from g1_description.robot.rotation import rotate
from g1_description.robot.state import RobotState
from g1_description.robot.transform import compose, inverse
from g1_description.scenes.scene import Scene

BLUE = (0.1, 0.35, 0.9)
"""Forces; what is missing is red."""

FORCES = "contact forces"
"""Namespace of the arrows."""

LENGTH = 0.5
"""Length of the arrow of a force as large as the weight of the robot, in [m]."""

SHORTEST = 0.01
"""Shorter arrows are not drawn, in [m]."""

SHAFT, HEAD, HEAD_LENGTH = 0.009, 0.022, 0.05
"""Radii of the shaft and the head of arrows, and length of the head, in [m]; the head
is at most half of an arrow."""

SIDES = 12
"""Arrows are prisms and pyramids with this number of sides."""

BEYOND = 0.1
"""Arrows are shown up to this time before and after the motion, in [s]."""

FAR = 0.2
"""A robot with a joint this far from the motion is somewhere else, in [rad] or [m]."""


class Arrow(NamedTuple):
    """A force."""

    start: np.ndarray
    """In [m], shape (3,)."""

    vector: np.ndarray
    """To its tip, in [m], shape (3,)."""

    color: Color

    def corners(self) -> np.ndarray:
        """Return the corners of its triangles in [m], shape (3 n, 3)."""
        length = float(np.linalg.norm(self.vector))
        along = self.vector / length
        across = np.cross(along, np.eye(3)[np.abs(along).argmin()])
        across /= np.linalg.norm(across)
        turns = 2.0 * np.pi / SIDES * np.arange(SIDES + 1)[:, np.newaxis]
        ring = np.cos(turns) * across + np.sin(turns) * np.cross(along, across)
        neck = length - min(HEAD_LENGTH, 0.5 * length)
        way = np.array([0.0, 0.0, neck, neck, length])[:, np.newaxis, np.newaxis]
        radius = np.array([0.0, SHAFT, SHAFT, HEAD, 0.0])[:, np.newaxis, np.newaxis]
        rings = self.start + way * along + radius * ring  # (5, SIDES + 1, 3)
        below, above = rings[:-1], rings[1:]
        one = below[:, :-1], below[:, 1:], above[:, 1:]
        other = below[:, :-1], above[:, 1:], above[:, :-1]
        return np.stack([*one, *other], axis=2).reshape(-1, 3)


@dataclass(frozen=True, eq=False)
class ForceArrows:
    """Contact forces of a motion as arrows along the map's axes.

    Values are NaN where forces are not known, and starts where there is no force.
    """

    motion: Motion
    times: np.ndarray
    """In [s], shape (n,)."""

    starts: np.ndarray
    """Centres of pressure of the links on which the floor ever pushes, and last the
    point of the floor below the centre of mass, in [m], shape (n, n_links + 1, 3)."""

    vectors: np.ndarray
    """Forces on these links, and last the missing force, each as an arrow in [m], shape
    (n, n_links + 1, 3)."""

    missing: np.ndarray
    """Sizes of the missing force and moment in [N] and [N m], shape (n, 2)."""

    is_missing: np.ndarray
    """Where more is missing than the check allows, shape (n,)."""

    def at(self, time: float) -> list[Arrow]:
        """Return the arrows of the sample next to a time in [s]."""
        row = self._row(time)
        if row is None:
            return []
        colors = [BLUE] * (self.starts.shape[1] - 1) + [RED]
        found = zip(self.starts[row], self.vectors[row], colors)
        return [Arrow(*one) for one in found if np.linalg.norm(one[1]) >= SHORTEST]

    def text(self, time: float) -> str:
        """Say what is missing at a time in [s]; empty if that is allowed."""
        row = self._row(time)
        if row is None or not self.is_missing[row]:
            return ""
        force, moment = self.missing[row]
        return f"{force:.0f} N and {moment:.1f} N m are missing"

    def on(self, state: RobotState, time: float) -> list[Arrow]:
        """Return the arrows at a time in [s], on a robot that may stand elsewhere.

        Returns:
            None of them if the robot is not posed as in the motion.
        """
        found, positions = sample(self.motion, time), state.positions_by_name
        names = self.motion.joint_names
        far = [positions.get(name, 0.0) for name in names] - found.positions
        if state.base_pose is None or found.base_poses is None:
            return []
        if (np.abs(far) > FAR).any():
            return []
        moved = compose(state.base_pose, inverse(found.base_poses))
        return [
            Arrow(
                moved[:3] + rotate(moved[3:], start), rotate(moved[3:], vector), color
            )
            for start, vector, color in self.at(time)
        ]

    def _row(self, time: float) -> int | None:
        """Find the nearest sample; None outside of the motion."""
        if not self.times[0] - BEYOND <= time <= self.times[-1] + BEYOND:
            return None
        return int(np.abs(self.times - time).argmin())


def force_arrows(verdict: Verdict) -> ForceArrows | None:
    """Return the contact forces of a checked motion; None if they are not known.

    Args:
        verdict: With its measurements.
    """
    measured = verdict.measured
    if measured is None or CONTACT_FORCES.name not in verdict.checked:
        return None
    found = measured.once(forces)
    least = CONTACT_FORCES.lowest(measured.robot.thresholds)
    columns = np.nan_to_num(found.forces).any(axis=(0, 2))
    below = found.center_of_mass.copy()
    below[:, 2] = measured.floor
    starts = np.append(found.points[:, columns], below[:, np.newaxis], axis=1)
    missing = found.missing.reshape(-1, 2, 3)
    vectors = np.append(found.forces[:, columns], missing[:, :1], axis=1)
    return ForceArrows(
        measured.motion,
        found.times,
        starts,
        LENGTH / found.weight[:, np.newaxis, np.newaxis] * vectors,
        np.linalg.norm(missing, axis=2),
        CONTACT_FORCES.exceeds(found.missing_share, least),
    )


def motion_arrows(
    robot: Description, motion: Motion, scene: Scene | None = None
) -> ForceArrows:
    """Find the contact forces of a motion.

    Args:
        robot: The robot.
        motion: Its motion.
        scene: The objects around it; None: none.

    Raises:
        MotionError: If they are not known.
        UnknownNameError: If an object is attached to a link that is not there.
    """
    checker = Checker(robot).among(scene or None)
    verdict = checker.check(motion, [CONTACT_FORCES.name])
    found = force_arrows(verdict)
    if found is None:
        (why,) = verdict.skipped.values()
        raise MotionError(f"Contact forces are unknown: {why}.")
    return found


def draw_forces(
    canvas: Canvas, arrows: Sequence[Arrow], text: str, base: np.ndarray
) -> None:
    """Draw contact forces.

    Args:
        canvas: In the map frame.
        arrows: The forces.
        text: What is missing; may be empty.
        base: Where the robot is, to which the text belongs: T_map_base, shape (7,).
    """
    for arrow in arrows:
        canvas.triangles(FORCES, arrow.corners(), arrow.color, 1.0)
    labels = [Label(base[:3], text, RED)] if text else []
    write_labels(canvas, FORCES, labels, base)
