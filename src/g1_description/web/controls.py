"""Controls of a robot: joint sliders, a gizmo for its base, named poses."""

from __future__ import annotations

import math
from collections.abc import Mapping
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from g1_description.bounds import MAX_VALUE
from g1_description.checks.rule import units
from g1_description.choices import ZERO
from g1_description.errors import InvalidValueError
from g1_description.robot.description import Joint, by_limb
from g1_description.robot.launch_arguments import LOWEST_FOOT
from g1_description.robot.poses import (
    Pose,
    check_name,
    check_pose,
    find_pose,
    fitting_poses,
    pose_positions,
    read_poses,
    save_pose,
    user_file,
)
from g1_description.robot.rotation import axes_to_rpy, from_rpy, to_axes
from g1_description.web.panel import RobotPanel
from g1_description.web.quantities import label_of
from g1_description.web.robot import ShownRobot
from g1_description.web.scene.stage import MAP
from g1_description.web.scene.tree import pose_of, wxyz

if TYPE_CHECKING:
    from viser import GuiSliderHandle


STEP = 0.001
"""Step of sliders, in [rad] or [m]."""

FINE = 5e-5
"""Smaller changes are not shown by sliders, in [rad] or [m]."""

UNLIMITED = {"prismatic": 1.0}
"""Range of the slider of a joint without limits, to both sides, by kind."""


class JointPanel(RobotPanel):
    """Sliders, with a tab for each limb."""

    def build(self) -> None:
        """Add the sliders."""
        self._sliders: dict[str, GuiSliderHandle[float]] = {}
        joints = {joint.name: joint for joint in self.robot.description.movable_joints}
        if not joints:
            return
        tabs = self.gui.add_tab_group()
        for limb, names in by_limb(joints).items():
            with tabs.add_tab(limb.capitalize()):
                for name in names:
                    slider = self._sliders[name] = self._add(joints[name])
                    self.ui.on(slider, partial(self._moved, name))

    def _add(self, joint: Joint) -> GuiSliderHandle[float]:
        """Add the slider of a joint."""
        lower, upper = slider_range(joint)
        unit = units(joint)[0]
        limits = f"from {joint.lower:g} to {joint.upper:g} {unit}"
        if not math.isfinite(joint.upper - joint.lower):
            limits = f"without limits, in {unit}"
        return self.gui.add_slider(
            label_of(joint.name),
            min=lower,
            max=upper,
            step=min(STEP, max(upper - lower, 1e-6)),
            initial_value=min(max(0.0, lower), upper),
            hint=f"{joint.name} {limits}",
            disabled=joint.lower >= joint.upper,
        )

    def _moved(self, name: str) -> None:
        """Command the position of a slider."""
        slider = self._sliders[name]
        value = float(slider.value)
        # Browsers send no other values; they may be forged, or NaN.
        if slider.min - STEP <= value <= slider.max + STEP:
            self.robot.command({name: min(max(value, slider.min), slider.max)})

    def update(self) -> None:
        """Show the joint positions, except of edited sliders."""
        state = self.shown.newest
        positions = {} if state is None else state.positions_by_name
        for name, slider in self._sliders.items():
            if name in positions:
                value = min(max(positions[name], slider.min), slider.max)
                self.show(slider, round(value, 4), FINE)


def slider_range(joint: Joint) -> tuple[float, float]:
    """Return the range of a joint's slider, in [rad] or [m]."""
    most = UNLIMITED.get(joint.kind, math.pi)
    lower = joint.lower if math.isfinite(joint.lower) else -most
    upper = joint.upper if math.isfinite(joint.upper) else most
    return (lower, upper) if lower < upper else (-most, most)


def known(positions: Mapping[str, float], robot: ShownRobot) -> dict[str, float]:
    """Return the known positions of a robot's joints in the order of its file.

    They are rounded, but not beyond a limit.
    """
    return {
        joint.name: min(max(round(positions[joint.name], 6), joint.lower), joint.upper)
        for joint in robot.description.movable_joints
        if joint.name in positions
    }


NONE = "none"
"""Entry of a list if no pose fits, or there is no anchor."""

LEAST_NORM = 0.1
"""Least length of a valid quaternion."""


class BasePanel(RobotPanel):
    """Controls and shows the base of one robot."""

    title = "Base"

    def build(self) -> None:
        """Add the fields, and a gizmo that is hidden."""
        gui, ui, robot = self.gui, self.ui, self.robot
        self._gizmo_on = gui.add_checkbox(
            "Gizmo", False, hint="arrows and rings that move the base"
        )
        self._place = gui.add_vector3(
            "x y z", (0.0, 0.0, 0.0), step=0.001, hint="of the base in the map, in m"
        )
        self._rpy = gui.add_vector3(
            "Roll pitch yaw", (0.0, 0.0, 0.0), step=STEP, hint="in rad"
        )
        self._fields = self._place, self._rpy
        self._anchor = gui.add_dropdown(
            "Anchor",
            [NONE, LOWEST_FOOT, *robot.description.link_names],
            hint="link that stays at its place while joints move; the base follows",
        )
        self._gizmo = self.scene.add_transform_controls(
            f"{MAP}/gizmos/{robot.name.replace('/', '_')}", scale=0.45, visible=False
        )
        ui.on(self._gizmo_on, self._show_gizmo)
        ui.on(self._anchor, lambda: ui.calls.do(self._set_anchor))
        ui.on(self._place, self._typed)
        ui.on(self._rpy, self._typed)
        ui.on(self._gizmo, self._dragged)

    @property
    def has_gizmo(self) -> bool:
        """Whether the gizmo is shown."""
        return bool(self._gizmo_on.value)

    def _show_gizmo(self) -> None:
        """Show the gizmo, or hide it."""
        self._gizmo.visible = self.has_gizmo

    def leave(self) -> None:
        """Hide the gizmo."""
        self._gizmo_on.value = self._gizmo.visible = False

    def _set_anchor(self) -> None:
        """Set the chosen anchor."""
        chosen = str(self._anchor.value)
        self.robot.set_anchor("" if chosen == NONE else chosen)

    def _typed(self) -> None:
        """Command the pose in the fields."""
        rpy = np.array(self._rpy.value, dtype=float)
        if rpy.shape == (3,):
            self._command(np.concatenate([self._place.value, from_rpy(rpy)]))

    def _dragged(self) -> None:
        """Command the pose of the gizmo."""
        self._command(pose_of(self._gizmo.position, self._gizmo.wxyz))

    def _command(self, given: np.ndarray) -> None:
        """Command a pose, if it is valid."""
        pose = valid_pose(given)
        if pose is not None:
            self.robot.command_base(pose)

    def update(self) -> None:
        """Show the pose of the base and the anchor, unless they are edited."""
        state = self.shown.newest
        if state is None or state.base_pose is None:
            return
        self._anchor.visible = self.robot.has_anchors
        self.show(self._anchor, self.robot.anchor or NONE)
        edits, pose = self.ui.edits, state.base_pose
        if any([edits.is_held(field) for field in self._fields]):
            return
        rpy = axes_to_rpy(to_axes(pose[3:]))
        for field, values in zip(self._fields, (pose[:3], rpy)):
            x, y, z = np.round(values, 4).tolist()
            self.show(field, (x, y, z), FINE)
        if self.has_gizmo and not edits.is_held(self._gizmo):
            self._gizmo.position, self._gizmo.wxyz = pose[:3], np.array(wxyz(pose))


def valid_pose(pose: np.ndarray) -> np.ndarray | None:
    """Return a pose from a browser with a unit quaternion; None if it is invalid."""
    # Browsers send no other values; viser does not validate them.
    if pose.shape != (7,) or not (np.abs(pose) <= MAX_VALUE).all():
        return None
    length = np.linalg.norm(pose[3:])
    return np.append(pose[:3], pose[3:] / length) if length > LEAST_NORM else None


MAX_SECONDS = 10.0


class PosePanel(RobotPanel):
    """Buttons of the poses that fit one robot."""

    title, is_open = "Poses", True

    def build(self) -> None:
        """Add the elements."""
        gui = self.gui
        self._seconds = gui.add_number(
            "Seconds",
            0.0,
            min=0.0,
            max=MAX_SECONDS,
            step=0.1,
            hint="duration of the motion; 0: at once",
        )
        self._poses = gui.add_button_group("Go to pose", [NONE])
        self._name = gui.add_text("Name", "", hint="of the pose to save")
        self._overwrite = gui.add_checkbox(
            "Overwrite", False, hint="a pose of that name, if there is one"
        )
        save = gui.add_button("Save pose", hint=f"into {user_file()}")
        self.refresh()
        self.ui.on(save, self._save)
        self.ui.on(self._poses, self._go)

    def refresh(self) -> None:
        """Update the list of poses, as others may have been saved."""
        self._poses.options = tuple(fitting_poses(self.robot.description)) or (NONE,)

    def _go(self) -> None:
        """Move the robot to the selected pose, read again from the file."""
        robot = self.robot.description
        pose = find_pose(self._poses.value, read_poses(robot))
        check_pose(pose, robot)
        names = [joint.name for joint in robot.movable_joints]
        goal = dict(zip(names, pose_positions(pose, robot).tolist()))
        seconds = float(self._seconds.value)
        if not 0.0 <= seconds <= MAX_SECONDS:
            raise InvalidValueError(
                f"Seconds must be from 0 to {MAX_SECONDS:g} (got {seconds:g})."
            )
        self.ui.calls.do(lambda: self.world.move(self.robot, goal, seconds))

    def _save(self) -> None:
        """Save the current pose under the name in the field."""
        name, state = self._name.value.strip(), self.robot.state()
        if not name:
            raise InvalidValueError("Enter a name for the pose.")
        check_name(name)
        if name == ZERO:
            raise InvalidValueError(f"{ZERO} is a built-in pose: choose another name.")
        if name in read_poses(self.robot.description) and not self._overwrite.value:
            raise InvalidValueError(
                f"The pose {name} already exists; tick Overwrite to replace it."
            )
        if state is None:
            raise InvalidValueError("Nothing to save: no state has been received yet.")
        positions = known(state.positions_by_name, self.robot)
        save_pose(Pose(name, positions, "saved in the browser"), user_file())
        self._overwrite.value = False
        self.page.refresh()
        self.ui.notify(f"Saved pose {name} in {user_file()}.", "green")
