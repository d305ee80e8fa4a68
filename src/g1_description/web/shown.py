"""Everything that is drawn of one robot."""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from g1_description.checks.arrows import ForceArrows, draw_forces
from g1_description.checks.marks import draw_marks, red_links
from g1_description.checks.verdict import Verdict
from g1_description.ik.posing import Posing
from g1_description.robot.rotation import angle_between
from g1_description.robot.state import RobotState
from g1_description.web.robot import ShownRobot
from g1_description.web.scene.marks import SceneMarks
from g1_description.web.scene.robot import SEE_THROUGH, SceneRobot
from g1_description.web.scene.stage import MAP
from g1_description.web.scene.trails import Trails

if TYPE_CHECKING:
    from viser import ViserServer


LIMIT_MARGIN = 0.05
"""Joints this near to a limit are marked, in [rad] or [m]."""

GHOST = (0.95, 0.6, 0.1, SEE_THROUGH)
"""Colour of the commanded configuration."""

STALE = 0.4
"""Marks of states older than this, relative to the shown one, are not drawn, in [s]."""

NEAR = 0.01
"""Least difference of the commanded configuration that is shown, in [m] or [rad]."""


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
        self.newest: RobotState | None = None
        """Its last state, which controls follow; None: there is none yet."""
        self._ghost: SceneRobot | None = None
        self._trails = Trails(self._scene, f"{MAP}/trails/{self._name}", description)
        self._canvas = SceneMarks(self._scene, f"{MAP}/checks/{self._name}")
        self._forces = SceneMarks(self._scene, f"{MAP}/forces/{self._name}")
        self._state: RobotState | None = None
        self._checked: RobotState | None = None
        self._marked: Verdict | None = None

    @cached_property
    def posing(self) -> Posing:
        """Poses the robot by hand, if its profile has links for that."""
        robot = self.robot
        return Posing(robot.description, robot.state, robot.command_all)

    def show(self, state: RobotState) -> None:
        """Show a state, which may be a past one."""
        self._state = state
        self.body.show(state.base_pose, state.positions_by_name)

    def show_commanded(self, is_on: bool) -> None:
        """Show the commanded configuration, where it differs from the measured one."""
        state = self._state
        is_seen = is_on and state is not None and _differs(state)
        if is_seen and state is not None:
            if self._ghost is None:
                path, robot = f"{MAP}/commanded/{self._name}", self.robot.description
                self._ghost = SceneRobot(self._scene, path, robot, GHOST)
            base = state.commanded_base
            self._ghost.show(
                state.base_pose if base is None else base,
                {**state.positions_by_name, **state.commanded},
            )
        if self._ghost is not None:
            self._ghost.visible = is_seen

    def trail(self, is_on: bool) -> None:
        """Extend the trails, or remove them."""
        if is_on and self._state is not None:
            state = self._state
            self._trails.add(state.time, state.base_pose, state.positions_by_name)
        else:
            self._trails.clear()

    def show_forces(self, forces: ForceArrows | None, time: float) -> None:
        """Show the contact forces at a time of a motion in [s]; None: show none."""
        state = self._state
        shown = forces.on(state, time) if forces and state is not None else []
        if forces and shown and state is not None and state.base_pose is not None:
            draw_forces(self._forces, shown, forces.text(time), state.base_pose)
        self._forces.show()

    @property
    def is_checked(self) -> bool:
        """Whether it was checked, and is marked."""
        return self._checked is not None

    def must_be_checked(self) -> bool:
        """Return whether its state is another one; it is checked from now on."""
        last, self._checked = self._checked, self._state
        return last is not self._state

    def mark(self, state: RobotState, verdict: Verdict) -> None:
        """Mark the findings of a state, unless they are marked."""
        if verdict is self._marked:
            return
        self.body.redden(red_links(verdict))
        seen = self._state or state
        is_fresh = abs(seen.time - state.time) < STALE
        if state.base_pose is not None and is_fresh:
            draw_marks(self._canvas, verdict, LIMIT_MARGIN)
        self._canvas.show()
        self._marked = verdict if is_fresh else None

    def unmark(self) -> None:
        """Remove the marks."""
        self._checked = self._marked = None
        self.body.redden(())
        self._canvas.show()


def _differs(state: RobotState) -> bool:
    """Return whether the commanded configuration is seen to be another."""
    base = state.commanded_base
    if base is not None and state.base_pose is not None:
        if np.abs(base[:3] - state.base_pose[:3]).max() > NEAR:
            return True
        if angle_between(base[3:], state.base_pose[3:]) > NEAR:
            return True
    measured = state.positions_by_name
    return any(
        abs(position - measured.get(name, position)) > NEAR
        for name, position in state.commanded.items()
    )
