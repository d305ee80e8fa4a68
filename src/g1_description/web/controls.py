"""What moves a robot by hand: sliders, a gizmo for its base, named poses."""

from __future__ import annotations

import math
import time
from collections.abc import Mapping
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from g1_description.bounds import MAX_VALUE
from g1_description.checks.rule import units
from g1_description.errors import G1DescriptionError, InvalidValueError
from g1_description.robot.description import Joint, by_limb
from g1_description.robot.poses import (
    ZERO,
    Pose,
    check_name,
    check_pose,
    find_pose,
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


class EditGuard:
    """Lets elements stay for a while where a person has put them.

    A person's value comes by a thread of viser's, and the thread that draws is told of
    it later. Until then, it must not show an older one in its place.
    """

    def __init__(self, seconds: float) -> None:
        """Hold nothing.

        Args:
            seconds: How long an element stays, in [s].
        """
        self._seconds = seconds
        self._seen: dict[int, Any] = {}
        self._until: dict[int, float] = {}

    def know(self, handle: Any) -> None:
        """Take the present value of an element for one of ours."""
        self._seen[id(handle)] = handle.value

    def hold(self, handle: Any) -> None:
        """Let an element stay as it is."""
        self._seen[id(handle)] = handle.value
        self._until[id(handle)] = time.monotonic() + self._seconds

    def is_held(self, handle: Any) -> bool:
        """Tell whether an element stays, also because a person has just moved it."""
        # The same object, as a value that is no number is not equal to itself.
        if handle.value is not self._seen.get(id(handle)):
            self.hold(handle)
        return time.monotonic() < self._until.get(id(handle), 0.0)

    def show(self, handle: Any, value: Any, tolerance: float = 0.0) -> None:
        """Show a value, if it is another one.

        A browser that sends a value does not hear of it, but may still get the one
        before. So what was held is shown again in any case.

        Args:
            handle: The element.
            value: A number, or some.
            tolerance: By how much it may be another one.
        """
        was_held = self._until.pop(id(handle), None) is not None
        is_same = np.shape(handle.value) == np.shape(value) and (
            np.abs(np.subtract(handle.value, value)).max() <= tolerance
        )
        if is_same and was_held:
            handle.value = np.add(value, 1.0)  # as viser sends only what changes
        if was_held or not is_same:
            handle.value = value
            self._seen[id(handle)] = handle.value

    def let_go(self) -> None:
        """Hold nothing any more."""
        self._until = dict.fromkeys(self._until, 0.0)


STEP = 0.001
"""Of sliders, in [rad] or [m]."""

FINE = 5e-5
"""Sliders show a change of more than this, in [rad] or [m]."""

UNLIMITED = {"prismatic": 1.0}
"""How far the slider of a joint without limits goes to both sides, by kind."""

HELD = 0.7
"""How long a slider that a person has moved does not follow the robot, in [s]: states
that are on their way are older than what the person wants."""

PERIOD = 0.1
"""Time between two looks at the robot by sliders, in [s]."""


class JointPanel:
    """Sliders in folders, one per limb."""

    def __init__(self, gui: GuiApi, ui: UiLoop, robot: ShownRobot) -> None:
        """Add the sliders.

        Args:
            gui: Where to.
            ui: Does what a person wants.
            robot: Whose joints they are.
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
        """Move a joint to where a person wants it."""
        slider = self._sliders[name]
        value = float(slider.value)
        # A browser sends no others; these come from elsewhere, or are not numbers.
        if slider.min - STEP <= value <= slider.max + STEP:
            self._guard.hold(slider)
            self._robot.command({name: min(max(value, slider.min), slider.max)})

    def follow(self, state: RobotState) -> None:
        """Show where the joints are, but those that a person moves."""
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
        """Follow the robot again: it is moved by other means."""
        self._guard.let_go()


def label_of(name: str) -> str:
    """Leave out what ends the names of most joints."""
    return name[: -len("_joint")] if name.endswith("_joint") else name


def slider_range(joint: Joint) -> tuple[float, float]:
    """Return from where to where a joint's slider goes, in [rad] or [m]."""
    most = UNLIMITED.get(joint.kind, math.pi)
    lower = joint.lower if math.isfinite(joint.lower) else -most
    upper = joint.upper if math.isfinite(joint.upper) else most
    return (lower, upper) if lower < upper else (-most, most)


def known(positions: Mapping[str, float], robot: ShownRobot) -> dict[str, float]:
    """Return the known positions of a robot's joints in the order of its file.

    They are rounded, but not to beyond a limit: others would refuse them.
    """
    return {
        joint.name: min(max(round(positions[joint.name], 6), joint.lower), joint.upper)
        for joint in robot.description.movable_joints
        if joint.name in positions
    }


LEAST_NORM = 0.1
"""A quaternion that is shorter has no direction."""


class BasePanel:
    """Moves the base of one robot, and shows where it is."""

    def __init__(self, server: ViserServer, ui: UiLoop, robot: ShownRobot) -> None:
        """Add the panel.

        Args:
            server: Where to.
            ui: Does what a person wants.
            robot: Whose base it is.
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
        self._gizmo = server.scene.add_transform_controls(
            f"{MAP}/gizmos/{robot.name.replace('/', '_')}", scale=0.45, visible=False
        )
        self._gizmo_turn = self._gizmo.wxyz
        self._fields = self._place, self._rpy
        for field in self._fields:
            self._guard.know(field)
        ui.on(self._gizmo_on, self._show_gizmo)
        ui.on(self._place, self._typed)
        ui.on(self._rpy, self._typed)
        ui.on(self._gizmo, self._dragged)

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
                self._guard.hold(field)
            pose[3:] /= np.linalg.norm(pose[3:])
            self._robot.command_base(pose)

    def follow(self, state: RobotState) -> None:
        """Show where the base is, unless a person moves it."""
        now = time.monotonic()
        if now < self._looked + PERIOD or state.base_pose is None:
            return
        self._looked = now
        if any([self._guard.is_held(field) for field in self._fields]):
            return
        self._show_fields(state.base_pose)
        # What is set here is written into viser's array; a person's comes as another
        # one, the turn first, and _dragged may not be told of it yet.
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

NONE = "none"
"""In the place of a pose where the robot can take none."""


class PosePanel:
    """Buttons of the poses that one robot can take."""

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
            gui: Where to.
            ui: Does what a person wants.
            world: What moves the robot.
            robot: The robot.
            joints: Its sliders, which follow what is done here.
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
            self._poses = gui.add_button_group("Take", self._names() or [NONE])
            self._name = gui.add_text("Name", "", hint="of the pose to save")
            self._replace = gui.add_checkbox(
                "Replace", False, hint="a pose of that name, if there is one"
            )
            save = gui.add_button("Save pose", hint=f"into {user_file()}")
        ui.on(save, self._save)
        ui.on(self._poses, self._take)

    def _names(self) -> list[str]:
        """Name the poses that the robot can take."""
        return [n for n, pose in read_poses().items() if _fits(pose, self._robot)]

    def _take(self) -> None:
        """Move the robot to a pose, as the file has it now."""
        pose = find_pose(self._poses.value, read_poses())
        robot = self._robot.description
        check_pose(pose, robot)
        names = [joint.name for joint in robot.movable_joints]
        goal = dict(zip(names, pose_positions(pose, robot).tolist()))
        seconds = float(self._seconds.value)
        if not 0.0 <= seconds <= MAX_SECONDS:
            raise InvalidValueError(
                f"Seconds must be from 0 to {MAX_SECONDS:g} (got {seconds:g})."
            )
        self._joints.let_go()
        self._ui.wait_for(lambda: self._world.move(self._robot, goal, seconds))

    def _save(self) -> None:
        """Save where the robot is under the name in the field."""
        name, state = self._name.value.strip(), self._robot.state()
        if not name:
            raise InvalidValueError("The pose has no name yet: type one above.")
        check_name(name)
        if name == ZERO:
            raise InvalidValueError(f"Every robot has {ZERO}: choose another name.")
        if name in read_poses() and not self._replace.value:
            raise InvalidValueError(
                f"There is a pose {name} already; tick Replace to save over it."
            )
        if state is None:
            raise InvalidValueError("There is nothing to save: no state has come yet.")
        positions = known(state.positions_by_name, self._robot)
        save_pose(Pose(name, positions, "saved in the browser"), user_file())
        self._replace.value = False
        self._poses.options = tuple(self._names())
        self._ui.tell(f"Pose {name} is in {user_file()}.", "green")


def _fits(pose: Pose, robot: ShownRobot) -> bool:
    """Tell whether a robot can take a pose."""
    try:
        check_pose(pose, robot.description)
    except G1DescriptionError:
        return False
    return True
