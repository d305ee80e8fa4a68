"""Controls of a robot: joint sliders, a gizmo for its base, named poses."""

from __future__ import annotations

import math
import time
from collections.abc import Mapping
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from g1_description.bounds import MAX_VALUE
from g1_description.checks.rule import units
from g1_description.errors import InvalidValueError
from g1_description.robot.description import Joint, by_limb
from g1_description.robot.launch_arguments import LOWEST_FOOT
from g1_description.robot.poses import (
    ZERO,
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
from g1_description.robot.state import RobotState
from g1_description.web.robot import ShownRobot, ShownWorld
from g1_description.web.scene.stage import MAP
from g1_description.web.scene.tree import pose_of, wxyz
from g1_description.web.ui_loop import UiLoop

if TYPE_CHECKING:
    from viser import GuiApi, GuiSliderHandle, ViserServer


ROUND_TRIP = 0.3
"""Longest time in [s] in which an update and an edit may cross on their ways."""


class EditGuard:
    """Keeps elements from being updated while a user edits them.

    A user's value is set by a thread of viser, and the UI loop learns of it later.
    Until then it must not overwrite it with an older one.
    """

    def __init__(self, seconds: float) -> None:
        """Create a guard.

        Args:
            seconds: How long an edited element is not updated, in [s].
        """
        self._seconds = seconds
        self._seen: dict[int, Any] = {}
        self._until: dict[int, float] = {}
        self._shown: dict[int, float] = {}
        self._crossed: set[int] = set()

    def know(self, handle: Any) -> None:
        """Record the current value of an element as set by the program."""
        self._seen[id(handle)] = handle.value

    def hold(self, handle: Any) -> None:
        """Keep an element from being updated for a while."""
        key, now = id(handle), time.monotonic()
        self._seen[key] = handle.value
        self._until[key] = now + self._seconds
        self._crossed.discard(key)
        if now < self._shown.get(key, -math.inf) + ROUND_TRIP:
            self._crossed.add(key)

    def is_held(self, handle: Any) -> bool:
        """Return whether an element was edited recently."""
        # By identity, as NaN is not equal to itself.
        if handle.value is not self._seen.get(id(handle)):
            self.hold(handle)
        return time.monotonic() < self._until.get(id(handle), 0.0)

    def show(self, handle: Any, value: Any, tolerance: float = 0.0) -> None:
        """Show a value, if it differs.

        A browser that sent a value may receive an older one afterwards, so an element
        that was edited just after an update is updated in any case. No other is, as
        that would undo what is being typed.

        Args:
            handle: The element.
            value: A number, or some.
            tolerance: Smaller differences are ignored.
        """
        key = id(handle)
        self._until.pop(key, None)
        is_crossed = key in self._crossed
        self._crossed.discard(key)
        is_same = np.shape(handle.value) == np.shape(value) and (
            np.abs(np.subtract(handle.value, value)).max() <= tolerance
        )
        if is_same and is_crossed:
            handle.value = np.add(value, 1.0)  # viser sends only changed values
        if is_crossed or not is_same:
            handle.value = value
            self._seen[key], self._shown[key] = handle.value, time.monotonic()

    def let_go(self) -> None:
        """Allow updates of all elements."""
        self._until = dict.fromkeys(self._until, 0.0)


STEP = 0.001
"""Step of sliders, in [rad] or [m]."""

FINE = 5e-5
"""Smaller changes are not shown by sliders, in [rad] or [m]."""

UNLIMITED = {"prismatic": 1.0}
"""Range of the slider of a joint without limits, to both sides, by kind."""

HELD = 0.7
"""Time for which an edited slider does not follow the robot, in [s]: states that arrive
meanwhile are older."""

PERIOD = 0.1
"""Period of updates, in [s]."""


class JointPanel:
    """Sliders in folders, one per limb."""

    def __init__(self, gui: GuiApi, ui: UiLoop, robot: ShownRobot) -> None:
        """Add the sliders.

        Args:
            gui: The GUI.
            ui: Runs the actions.
            robot: The robot.
        """
        self._robot = robot
        self._sliders: dict[str, GuiSliderHandle[float]] = {}
        self._guard = EditGuard(HELD)
        self._looked = 0.0
        joints = {joint.name: joint for joint in robot.description.movable_joints}
        for limb, names in by_limb(joints).items():
            with gui.add_folder(limb.capitalize(), expand_by_default=len(joints) < 12):
                for name in names:
                    slider = self._add(gui, joints[name])
                    self._sliders[name] = slider
                    self._guard.know(slider)
                    ui.on(slider, partial(self._moved, name))

    @staticmethod
    def _add(gui: GuiApi, joint: Joint) -> GuiSliderHandle[float]:
        """Add the slider of a joint."""
        lower, upper = slider_range(joint)
        unit = units(joint)[0]
        limits = f"from {joint.lower:g} to {joint.upper:g} {unit}"
        if not math.isfinite(joint.upper - joint.lower):
            limits = f"without limits, in {unit}"
        return gui.add_slider(
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
            self._guard.hold(slider)
            self._robot.command({name: min(max(value, slider.min), slider.max)})

    def follow(self, state: RobotState) -> None:
        """Show the joint positions, except of edited sliders."""
        now = time.monotonic()
        if now < self._looked + PERIOD:
            return
        self._looked = now
        positions = state.positions_by_name
        for name, slider in self._sliders.items():
            place = positions.get(name)
            if place is None or self._guard.is_held(slider):
                continue
            value = min(max(place, slider.min), slider.max)
            self._guard.show(slider, round(value, 4), FINE)

    def let_go(self) -> None:
        """Follow the robot again, as it is moved by other means."""
        self._guard.let_go()


def label_of(name: str) -> str:
    """Remove the usual suffix of a joint's name."""
    return name[: -len("_joint")] if name.endswith("_joint") else name


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


class BasePanel:
    """Controls and shows the base of one robot."""

    def __init__(self, server: ViserServer, ui: UiLoop, robot: ShownRobot) -> None:
        """Add the panel.

        Args:
            server: The server.
            ui: Runs the actions.
            robot: The robot.
        """
        self._robot = robot
        self._guard = EditGuard(HELD)
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
            self._anchor = gui.add_dropdown(
                "Anchor",
                [NONE, LOWEST_FOOT, *robot.description.link_names],
                hint="link that stays at its place while joints move; the base follows",
            )
        self._gizmo = server.scene.add_transform_controls(
            f"{MAP}/gizmos/{robot.name.replace('/', '_')}", scale=0.45, visible=False
        )
        self._gizmo_turn = self._gizmo.wxyz
        self._fields = self._place, self._rpy
        for field in (*self._fields, self._anchor):
            self._guard.know(field)
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
        self._gizmo.visible = bool(self._gizmo_on.value)

    def _set_anchor(self) -> None:
        """Set the chosen anchor."""
        chosen = str(self._anchor.value)
        self._robot.set_anchor("" if chosen == NONE else chosen)

    def _show_anchor(self) -> None:
        """Show the anchor where there can be one, unless it is edited."""
        if self._anchor.visible != self._robot.has_anchors:
            self._anchor.visible = self._robot.has_anchors
        anchor = self._robot.anchor or NONE
        if self._anchor.value != anchor and not self._guard.is_held(self._anchor):
            self._anchor.value = anchor
            self._guard.know(self._anchor)

    def _typed(self) -> None:
        """Command the pose in the fields."""
        rpy = np.array(self._rpy.value, dtype=float)
        if rpy.shape == (3,):
            self._command(np.concatenate([self._place.value, from_rpy(rpy)]))

    def _dragged(self) -> None:
        """Command the pose of the gizmo."""
        self._gizmo_turn = self._gizmo.wxyz
        pose = pose_of(self._gizmo.position, self._gizmo_turn)
        self._command(pose)
        self._show_fields(pose)

    def _command(self, pose: np.ndarray) -> None:
        """Command a pose, if it is valid."""
        # Browsers send no other values; viser does not validate them.
        if pose.shape != (7,) or not (np.abs(pose) <= MAX_VALUE).all():
            return
        if np.linalg.norm(pose[3:]) > LEAST_NORM:
            for field in self._fields:
                self._guard.hold(field)
            pose[3:] /= np.linalg.norm(pose[3:])
            self._robot.command_base(pose)

    def follow(self, state: RobotState) -> None:
        """Show the pose of the base, unless it is edited."""
        now = time.monotonic()
        if now < self._looked + PERIOD or state.base_pose is None:
            return
        self._looked = now
        self._show_anchor()
        if any([self._guard.is_held(field) for field in self._fields]):
            return
        self._show_fields(state.base_pose)
        # Values set here are written into viser's array. A user's value is another
        # array, wxyz first, and _dragged may not have been called yet.
        if self._gizmo_on.value and self._gizmo.wxyz is self._gizmo_turn:
            self._gizmo.position = state.base_pose[:3]
            self._gizmo.wxyz = np.array(wxyz(state.base_pose))

    def _show_fields(self, pose: np.ndarray) -> None:
        """Show a pose in the fields."""
        rpy = axes_to_rpy(to_axes(pose[3:]))
        for field, values in zip(self._fields, (pose[:3], rpy)):
            x, y, z = np.round(values, 4).tolist()
            self._guard.show(field, (x, y, z), FINE)


MAX_SECONDS = 10.0


class PosePanel:
    """Buttons of the poses that fit one robot."""

    def __init__(
        self,
        gui: GuiApi,
        ui: UiLoop,
        world: ShownWorld,
        robot: ShownRobot,
        joints: JointPanel,
    ) -> None:
        """Add the panel.

        Args:
            gui: The GUI.
            ui: Runs the actions.
            world: Moves the robot.
            robot: The robot.
            joints: Its sliders.
        """
        self._gui, self._ui, self._world = gui, ui, world
        self._robot, self._joints = robot, joints
        folder = gui.add_folder("Poses")
        with folder:
            self._seconds = gui.add_number(
                "Seconds",
                0.0,
                min=0.0,
                max=MAX_SECONDS,
                step=0.1,
                hint="duration of the motion; 0: at once",
            )
            self._poses = gui.add_button_group(
                "Go to pose", fitting_poses(robot.description) or [NONE]
            )
            self._name = gui.add_text("Name", "", hint="of the pose to save")
            self._overwrite = gui.add_checkbox(
                "Overwrite", False, hint="a pose of that name, if there is one"
            )
            save = gui.add_button("Save pose", hint=f"into {user_file()}")
        ui.on(save, self._save)
        ui.on(self._poses, self._go)

    def refresh(self) -> None:
        """Update the list of poses, as others may have been saved."""
        self._poses.options = tuple(fitting_poses(self._robot.description)) or (NONE,)

    def _go(self) -> None:
        """Move the robot to the selected pose, read again from the file."""
        robot = self._robot.description
        pose = find_pose(self._poses.value, read_poses(robot))
        check_pose(pose, robot)
        names = [joint.name for joint in robot.movable_joints]
        goal = dict(zip(names, pose_positions(pose, robot).tolist()))
        seconds = float(self._seconds.value)
        if not 0.0 <= seconds <= MAX_SECONDS:
            raise InvalidValueError(
                f"Seconds must be from 0 to {MAX_SECONDS:g} (got {seconds:g})."
            )
        self._joints.let_go()
        self._ui.calls.do(lambda: self._world.move(self._robot, goal, seconds))

    def _save(self) -> None:
        """Save the current pose under the name in the field."""
        name, state = self._name.value.strip(), self._robot.state()
        if not name:
            raise InvalidValueError("Enter a name for the pose.")
        check_name(name)
        if name == ZERO:
            raise InvalidValueError(f"{ZERO} is a built-in pose: choose another name.")
        if name in read_poses(self._robot.description) and not self._overwrite.value:
            raise InvalidValueError(
                f"The pose {name} already exists; tick Overwrite to replace it."
            )
        if state is None:
            raise InvalidValueError("Nothing to save: no state has been received yet.")
        positions = known(state.positions_by_name, self._robot)
        save_pose(Pose(name, positions, "saved in the browser"), user_file())
        self._overwrite.value = False
        self.refresh()
        self._ui.tell(f"Saved pose {name} in {user_file()}.", "green")
