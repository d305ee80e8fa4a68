"""Where the base is: fields, and a gizmo in the scene."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING

import numpy as np

from g1_description.bounds import MAX_VALUE
from g1_description.robot.rotation import axes_to_rpy, from_rpy, to_axes
from g1_description.web.edit_guard import Held
from g1_description.web.joint_controls import FINE, HELD, PERIOD, STEP
from g1_description.web.robot import ShownRobot, ShownState
from g1_description.web.scene.stage import MAP
from g1_description.web.scene.tree import pose_of, wxyz
from g1_description.web.ui_loop import Desk

if TYPE_CHECKING:
    from viser import ViserServer


LEAST_NORM = 0.1
"""A quaternion that is shorter has no direction."""


class BasePanel:
    """Moves the base of one robot, and shows where it is."""

    def __init__(self, server: ViserServer, desk: Desk, robot: ShownRobot) -> None:
        """Add the panel.

        Args:
            server: Where to.
            desk: Does what a person wants.
            robot: Whose base it is.
        """
        self._robot = robot
        self._held = Held(HELD)
        self._looked = 0.0
        gui = server.gui
        with gui.add_folder("Base", expand_by_default=False):
            self._gizmo_on = gui.add_checkbox(
                "Gizmo", False, hint="arrows and rings that move the base"
            )
            self._place = gui.add_vector3(
                "x y z",
                (0.0, 0.0, 0.0),
                step=0.001,
                hint="of the base in the map, in m",
            )
            self._rpy = gui.add_vector3(
                "Roll pitch yaw", (0.0, 0.0, 0.0), step=STEP, hint="in rad"
            )
        self._gizmo = server.scene.add_transform_controls(
            f"{MAP}/gizmos/{robot.name.replace('/', '_')}", scale=0.45, visible=False
        )
        self._gizmo_turn = self._gizmo.wxyz
        self._fields = self._place, self._rpy
        for field in self._fields:
            self._held.know(field)
        desk.on(self._gizmo_on, self._show_gizmo)
        desk.on(self._place, self._typed)
        desk.on(self._rpy, self._typed)
        desk.on(self._gizmo, self._dragged)

    @property
    def has_gizmo(self) -> bool:
        """Whether the gizmo is seen."""
        return bool(self._gizmo_on.value)

    def _show_gizmo(self) -> None:
        """Show the gizmo, or hide it."""
        self._gizmo.visible = bool(self._gizmo_on.value)

    def _typed(self) -> None:
        """Move the base to where the fields say."""
        rpy = np.array(self._rpy.value, dtype=float)
        if rpy.shape == (3,):
            self._command(np.concatenate([self._place.value, from_rpy(rpy)]))

    def _dragged(self) -> None:
        """Move the base to where the gizmo is."""
        self._gizmo_turn = self._gizmo.wxyz
        pose = pose_of(self._gizmo.position, self._gizmo_turn)
        self._command(pose)
        self._show_fields(pose)

    def _command(self, pose: np.ndarray) -> None:
        """Move the base, if that is a pose."""
        # A browser sends no others; a field of two numbers would be kept, too.
        if pose.shape != (7,) or not (np.abs(pose) <= MAX_VALUE).all():
            return
        if np.linalg.norm(pose[3:]) > LEAST_NORM:
            for field in self._fields:
                self._held.hold(field)
            pose[3:] /= np.linalg.norm(pose[3:])
            self._robot.command_base(pose)

    def follow(self, state: ShownState) -> None:
        """Show where the base is, unless a person moves it."""
        now = time.monotonic()
        if now < self._looked + PERIOD or state.base is None:
            return
        self._looked = now
        if any([self._held.is_held(field) for field in self._fields]):
            return
        self._show_fields(state.base)
        # What is set here is written into viser's array; a person's comes as another
        # one, the turn first, and _dragged may not be told of it yet.
        if self._gizmo_on.value and self._gizmo.wxyz is self._gizmo_turn:
            self._gizmo.position = state.base[:3]
            self._gizmo.wxyz = np.array(wxyz(state.base))

    def _show_fields(self, pose: np.ndarray) -> None:
        """Show a pose in the fields."""
        rpy = axes_to_rpy(to_axes(pose[3:]))
        for field, values in zip(self._fields, (pose[:3], rpy)):
            x, y, z = np.round(values, 4).tolist()
            self._held.show(field, (x, y, z), FINE)
