"""Named poses: a button for each, and one that saves where the robot is."""

from __future__ import annotations

from typing import TYPE_CHECKING

from g1_description.errors import G1DescriptionError, InvalidValueError
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
from g1_description.web.joint_controls import JointPanel, known
from g1_description.web.robot import ShownRobot, ShownWorld
from g1_description.web.ui_loop import Desk

if TYPE_CHECKING:
    from viser import GuiApi


MAX_SECONDS = 10.0

NONE = "none"
"""In the place of a pose where the robot can take none."""


class PosePanel:
    """Buttons of the poses that one robot can take."""

    def __init__(
        self,
        gui: GuiApi,
        desk: Desk,
        world: ShownWorld,
        robot: ShownRobot,
        joints: JointPanel,
    ) -> None:
        """Add the panel.

        Args:
            gui: Where to.
            desk: Does what a person wants.
            world: What moves the robot.
            robot: The robot.
            joints: Its sliders, which follow what is done here.
        """
        self._gui, self._desk, self._world = gui, desk, world
        self._robot, self._joints = robot, joints
        folder = gui.add_folder("Poses")
        with folder:
            self._seconds = gui.add_number(
                "Seconds",
                0.0,
                min=0.0,
                max=MAX_SECONDS,
                step=0.1,
                hint="how long the way takes; 0: at once",
            )
            self._poses = gui.add_button_group("Take", self._names() or [NONE])
            self._name = gui.add_text("Name", "", hint="of the pose to save")
            self._replace = gui.add_checkbox(
                "Replace", False, hint="a pose of that name, if there is one"
            )
            save = gui.add_button("Save pose", hint=f"into {user_file()}")
        desk.on(save, self._save)
        desk.on(self._poses, self._take)

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
            raise InvalidValueError(f"{seconds:g} is no time from 0 to 10 s.")
        self._joints.let_go()
        self._desk.wait_for(lambda: self._world.move(self._robot, goal, seconds))

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
        positions = known(state.positions, self._robot)
        save_pose(Pose(name, positions, "saved in the browser"), user_file())
        self._replace.value = False
        self._poses.options = tuple(self._names())
        self._desk.tell(f"Pose {name} is in {user_file()}.", "green")


def _fits(pose: Pose, robot: ShownRobot) -> bool:
    """Tell whether a robot can take a pose."""
    try:
        check_pose(pose, robot.description)
    except G1DescriptionError:
        return False
    return True
