"""Gizmos on hands, feet and other links of a robot, which the whole body follows."""

from __future__ import annotations

import math
import time
from functools import partial
from typing import TYPE_CHECKING, Tuple

import numpy as np

from g1_description.bounds import MAX_VALUE
from g1_description.errors import InvalidValueError
from g1_description.ik.inverse_kinematics import IkOptions, InverseKinematics
from g1_description.ik.solver import IkSolver
from g1_description.motion.mirror import mirrored
from g1_description.motion.motion import Motion
from g1_description.robot.assembly import WORLD, root_in_base
from g1_description.robot.kinematics import Kinematics
from g1_description.robot.launch_arguments import FEET
from g1_description.robot.state import RobotState
from g1_description.robot.transform import compose
from g1_description.web.controls import HELD, LEAST_NORM, PERIOD, JointPanel
from g1_description.web.findings_panel import plain
from g1_description.web.robot import ShownRobot
from g1_description.web.scene.stage import MAP
from g1_description.web.scene.tree import pose_of, wxyz
from g1_description.web.ui_loop import UiLoop

if TYPE_CHECKING:
    from collections.abc import Callable

    from viser import ViserServer

    from g1_description.collisions.self_collisions import SelfCollisions

IMU = "imu"
"""The only role of a profile whose link has no gizmo."""

SCALE = 0.2
"""Length of a gizmo's arrows, in [m]."""

MAX_UNDO = 100
"""Number of changes that can be undone."""

Placed = Tuple[np.ndarray, np.ndarray]
"""Positions of joints, in the order of the robot, and the pose of its base."""


class ReachPanel:
    """Inverse kinematics of one robot."""

    def __init__(
        self,
        server: ViserServer,
        ui: UiLoop,
        robot: ShownRobot,
        joints: JointPanel,
        collisions: Callable[[], SelfCollisions],
    ) -> None:
        """Add the panel.

        Args:
            server: The server.
            ui: Runs the actions.
            robot: The robot, with links in its profile.
            joints: Its sliders.
            collisions: Prepares its self-collisions, which may take seconds.
        """
        self._ui, self._robot, self._joints = ui, robot, joints
        description = robot.description
        self._names = tuple(joint.name for joint in description.movable_joints)
        self._kinematics = Kinematics(description)
        self._T_base_root = root_in_base(description)
        self._inverse = InverseKinematics(description, IkSolver(description))
        self._make_collisions = collisions
        self._apart: InverseKinematics | None = None
        self._links = roles_of(robot)
        self._begin: Placed | None = None
        """Where the robot was when the present drag began."""
        self._now: Placed | None = None
        self._dragged_at = dict.fromkeys(self._links, -math.inf)
        self._looked = 0.0
        self._undone: list[Placed] = []
        self._past: list[Placed] = []
        self._add(server)

    def _add(self, server: ViserServer) -> None:
        """Add controls and gizmos."""
        gui, ui, name = server.gui, self._ui, self._robot.name.replace("/", "_")
        with gui.add_folder("Reach", expand_by_default=False):
            self._on = gui.add_checkbox(
                "Gizmos",
                False,
                hint="on hands, feet and other links; the whole body follows",
            )
            self._holds = {
                foot: gui.add_checkbox(f"{_label(foot)} stays", True)
                for foot in FEET
                if foot in self._links
            }
            self._balance = gui.add_checkbox(
                "Balance", True, hint="centre of mass above the feet that stay"
            )
            self._avoid = gui.add_checkbox(
                "Avoid collisions", False, hint="links keep 2 mm from each other"
            )
            self._steps = gui.add_button_group("Change", ["Undo", "Redo", "Mirror"])
            self._told = gui.add_markdown("", visible=False)
        ui.on(self._on, self._show_gizmos)
        ui.on(self._avoid, self._prepare)
        ui.on(self._steps, self._change)
        self._gizmos = {
            role: server.scene.add_transform_controls(
                f"{MAP}/reach/{name}/{role}", scale=SCALE, visible=False
            )
            for role in self._links
        }
        self._turns = {role: gizmo.wxyz for role, gizmo in self._gizmos.items()}
        for role, gizmo in self._gizmos.items():
            ui.on(gizmo, partial(self._dragged, role))

    @property
    def has_gizmos(self) -> bool:
        """Whether the gizmos are shown."""
        return bool(self._on.value)

    def _show_gizmos(self) -> None:
        """Show the gizmos, or hide them."""
        self._looked = 0.0
        for gizmo in self._gizmos.values():
            gizmo.visible = self.has_gizmos

    def _prepare(self) -> None:
        """Prepare self-collisions on first use."""
        if self._avoid.value and self._apart is None:
            description = self._robot.description

            def ready(shapes: SelfCollisions) -> None:
                self._apart = InverseKinematics(
                    description, IkSolver(description, shapes)
                )

            self._ui.wait_for(self._make_collisions, ready)

    def _place(self) -> Placed:
        """Return where the robot is.

        Raises:
            InvalidValueError: If that is unknown.
        """
        state = self._robot.state()
        if state is None or state.base_pose is None:
            raise InvalidValueError("The state of the robot or its base is unknown.")
        known = state.positions_by_name
        missing = [name for name in self._names if name not in known]
        if missing:
            raise InvalidValueError(f"The position of {missing[0]} is unknown.")
        return np.array([known[name] for name in self._names]), state.base_pose

    def _dragged(self, role: str) -> None:
        """Move the robot so that a link follows its gizmo."""
        gizmo = self._gizmos[role]
        self._turns[role] = gizmo.wxyz
        pose = pose_of(gizmo.position, gizmo.wxyz)
        # Browsers send no other values; viser does not validate them.
        if pose.shape != (7,) or not (np.abs(pose) <= MAX_VALUE).all():
            return
        length = np.linalg.norm(pose[3:])
        if not length > LEAST_NORM:
            return
        pose[3:] /= length
        is_new = not self._is_dragged(role)
        self._dragged_at[role] = time.monotonic()
        if is_new or self._begin is None or self._now is None:
            self._begin = self._now = self._place()
            self._remember(self._begin)
        held = [foot for foot, box in self._holds.items() if box.value and foot != role]
        options = IkOptions(
            hold=held,
            balance=bool(self._balance.value and held),
            collisions=bool(self._avoid.value) and self._apart is not None,
            base_motion="free",
        )
        inverse = (self._apart if options.collisions else None) or self._inverse
        try:
            found = inverse.solve({role: pose}, *self._begin, options, 1, self._now)
        except InvalidValueError as error:
            self._tell(str(error))
            return
        self._now = found.positions, found.base
        self._command(self._now)
        self._tell(found.message)

    def _is_dragged(self, role: str) -> bool:
        """Return whether a gizmo was dragged recently."""
        return time.monotonic() < self._dragged_at[role] + HELD

    def _command(self, placed: Placed) -> None:
        """Command a configuration."""
        positions, base = placed
        self._joints.let_go()
        self._robot.command_all(dict(zip(self._names, positions.tolist())), base)

    def _tell(self, text: str) -> None:
        """Show a sentence, or none."""
        self._told.content = plain(text)
        self._told.visible = bool(text)

    def _remember(self, placed: Placed) -> None:
        """Let a change be undone."""
        self._past = [*self._past[1 - MAX_UNDO :], placed]
        self._undone.clear()

    def _change(self) -> None:
        """Undo, redo or mirror."""
        now, wanted = self._place(), self._steps.value
        if wanted == "Mirror":
            self._remember(now)
            motion = Motion(np.zeros(1), self._names, now[0][None], None, now[1][None])
            other = mirrored(motion, self._robot.description)
            by_name = dict(zip(other.joint_names, other.positions[0].tolist()))
            positions = np.array([by_name[name] for name in self._names])
            assert other.base_poses is not None
            self._command((positions, other.base_poses[0]))
        else:
            source, other_side = self._past, self._undone
            if wanted == "Redo":
                source, other_side = self._undone, self._past
            if not source:
                raise InvalidValueError(f"There is nothing to {wanted.lower()}.")
            other_side.append(now)
            self._command(source.pop())
        self._dragged_at = dict.fromkeys(self._links, -math.inf)
        self._tell("")

    def follow(self, state: RobotState) -> None:
        """Put gizmos that are not dragged on their links."""
        now = time.monotonic()
        if not self.has_gizmos or now < self._looked + PERIOD:
            return
        if state.base_pose is None:
            return
        self._looked = now
        known = state.positions_by_name
        positions = np.array([known.get(name, 0.0) for name in self._names])
        root = compose(state.base_pose, self._T_base_root)
        poses = self._kinematics.link_poses(root, positions)
        for role, row in self._links.items():
            gizmo = self._gizmos[role]
            # A person's value is another array, and may not have been heard yet.
            if self._is_dragged(role) or gizmo.wxyz is not self._turns[role]:
                continue
            gizmo.position = poses[row, :3]
            gizmo.wxyz = np.array(wxyz(poses[row]))


def roles_of(robot: ShownRobot) -> dict[str, int]:
    """Find the links that have gizmos, as rows by role."""
    description = robot.description
    profile = description.given_profile or description.profile
    names = [name for name in description.link_names if name != WORLD]
    return {
        role: names.index(link)
        for role, link in profile.links.items()
        if link in names and role != IMU
    }


def _label(role: str) -> str:
    """Write a role as text."""
    return role.replace("_", " ").capitalize()
