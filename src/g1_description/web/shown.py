"""All that is drawn of one robot."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from g1_description.checks.marks import draw_marks, red_links
from g1_description.checks.verdict import Verdict
from g1_description.robot.rotation import angle_between
from g1_description.web.base_controls import BasePanel
from g1_description.web.joint_controls import JointPanel
from g1_description.web.robot import ShownRobot, ShownState
from g1_description.web.scene.marks import SceneMarks
from g1_description.web.scene.robot import SEE_THROUGH, SceneRobot
from g1_description.web.scene.stage import MAP
from g1_description.web.scene.trails import Trails

if TYPE_CHECKING:
    from viser import ViserServer


LIMIT_MARGIN = 0.05
"""Joints this near to a limit are marked, in [rad] or [m]."""

GHOST = (0.95, 0.6, 0.1, SEE_THROUGH)
"""Colour of where a robot is wanted."""

STALE = 0.4
"""Marks of a state that is older than what is shown by so much are left out, in [s]:
they would lie where the robot was."""

NEAR = 0.01
"""A robot this near to where it is wanted is there, in [m] or [rad]."""


class Shown:
    """One robot in the scene, with its ghost, its trails and its marks."""

    def __init__(self, server: ViserServer, robot: ShownRobot, name: str) -> None:
        """Add the robot.

        Args:
            server: Where to.
            robot: The robot.
            name: Its own name in the scene.
        """
        self.robot = robot
        self._scene = server.scene
        self._name = name
        description = robot.description
        self.body = SceneRobot(self._scene, f"{MAP}/robots/{self._name}", description)
        self.joints: JointPanel | None = None
        """Its sliders, where it can be moved."""
        self.base: BasePanel | None = None
        self._ghost: SceneRobot | None = None
        self._trails = Trails(self._scene, f"{MAP}/trails/{self._name}", description)
        self._canvas = SceneMarks(self._scene, f"{MAP}/checks/{self._name}")
        self._state: ShownState | None = None
        self._checked: ShownState | None = None

    def show(self, state: ShownState) -> None:
        """Show where the robot is."""
        self._state = state
        self.body.show(state.base, state.positions)
        if self.joints is not None:
            self.joints.follow(state)
        if self.base is not None:
            self.base.follow(state)

    def show_wanted(self, wanted: ShownState | None) -> None:
        """Show where the robot is wanted, if that is elsewhere; None: do not."""
        is_seen = wanted is not None and _differ(wanted, self._state)
        if is_seen and wanted is not None:
            if self._ghost is None:
                path, robot = f"{MAP}/commanded/{self._name}", self.robot.description
                self._ghost = SceneRobot(self._scene, path, robot, GHOST)
            self._ghost.show(wanted.base, wanted.positions)
        if self._ghost is not None and self._ghost.visible != is_seen:
            self._ghost.visible = is_seen

    def trail(self, is_on: bool) -> None:
        """Go on with the trails, or show none."""
        if is_on and self._state is not None:
            state = self._state
            self._trails.add(state.time, state.base, state.positions)
        else:
            self._trails.clear()

    @property
    def is_checked(self) -> bool:
        """Whether it was checked, and is marked."""
        return self._checked is not None

    def must_be_checked(self) -> bool:
        """Tell whether it has moved since it was checked, which it is from now on."""
        last, self._checked = self._checked, self._state
        return last is None or not _same(last, self._state)

    def mark(self, state: ShownState, verdict: Verdict) -> None:
        """Mark what was found where the robot is."""
        self.body.redden(red_links(verdict))
        newest = self._state or state
        if state.base is not None and newest.time - state.time < STALE:
            draw_marks(self._canvas, verdict, LIMIT_MARGIN)
        self._canvas.show()

    def unmark(self) -> None:
        """Leave no marks."""
        self._checked = None
        self.body.redden(())
        self._canvas.show()


def _differ(wanted: ShownState, state: ShownState | None) -> bool:
    """Tell whether a robot is seen to be elsewhere than it is wanted."""
    if state is None:
        return False
    if wanted.base is not None and state.base is not None:
        if np.abs(wanted.base[:3] - state.base[:3]).max() > NEAR:
            return True
        if angle_between(wanted.base[3:], state.base[3:]) > NEAR:
            return True
    return any(
        abs(position - state.positions.get(name, position)) > NEAR
        for name, position in wanted.positions.items()
    )


def _same(a: ShownState, b: ShownState | None) -> bool:
    """Tell whether two states are of one place."""
    if b is None or (a.base is None) != (b.base is None):
        return False
    if a.base is not None and b.base is not None and (a.base != b.base).any():
        return False
    return dict(a.positions) == dict(b.positions)
