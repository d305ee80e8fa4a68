"""The command pose, which moves a robot to a named pose, lists poses or saves one."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from contextlib import suppress

import numpy as np
import rosgraph
import rospy
from sensor_msgs.msg import JointState

from g1_description.choices import DEFAULT
from g1_description.cli.pose_options import PoseOptions
from g1_description.command_line import exit_with_error, say
from g1_description.errors import G1DescriptionError, PoseFileError
from g1_description.motion.edit import minimum_jerk_trajectory
from g1_description.robot.load import read_description
from g1_description.robot.poses import (
    Pose,
    check_name,
    check_pose,
    find_pose,
    fits,
    pose_positions,
    read_poses,
    save_pose,
    user_file,
)
from g1_description.robot.state import RobotState
from g1_description.ros.lifecycle import quiet_when_closing, start_node
from g1_description.ros.parameters import DESCRIPTION, find_parameter, read_robot
from g1_description.ros.robot_view import STANDS_STILL, RobotView
from g1_description.ros.waiting import NoAnswerError, RefusedError
from g1_description.text import listed

TIMEOUT = 30.0
"""Longest wait for the bridge and its effect, in [s]: machines may be busy."""

RESEND_PERIOD = 1.0
"""Period with which a goal is sent, in [s]."""

TOLERANCE = 0.01
"""Largest distance of a joint from its goal, in [rad] or [m]: motors have errors."""


class PosedRobot(RobotView):
    """A running robot that can be moved."""

    def __init__(self, namespace: str, notify: Callable[[str], None]) -> None:
        super().__init__(namespace, notify)
        self._names = [joint.name for joint in self.description.movable_joints]
        self._commands = rospy.Publisher(
            f"{self._prefix}joint_commands",
            JointState,
            queue_size=10,
            tcp_nodelay=True,
        )
        # Before the shutdown, while services can be called: else the robot continues.
        rospy.core.add_preshutdown_hook(lambda _: self._leave())

    def teleport(self, goal: np.ndarray) -> None:
        """Set all joints, repeatedly, until the robot's state shows it.

        Args:
            goal: Positions in [rad] or [m], shape (n_joints,).

        Raises:
            NoAnswerError: If nothing subscribes, or the joints do not reach the goal.
        """
        if not self.wait_until(self._commands.get_num_connections, TIMEOUT):
            name = self._commands.resolved_name
            raise NoAnswerError(f"Nothing subscribes to {name}; is the bridge running?")
        sent = -np.inf

        def send_again():
            nonlocal sent
            if time.monotonic() >= sent + RESEND_PERIOD:
                message = JointState(name=self._names, position=goal.tolist())
                message.header.stamp = rospy.Time.now()
                with quiet_when_closing():
                    self._commands.publish(message)
                sent = time.monotonic()

        self._wait_for_goal(goal, send_again)

    def move(self, goal: np.ndarray, seconds: float) -> None:
        """Move all joints from their current positions, from rest to rest.

        Args:
            goal: Positions in [rad] or [m], shape (n_joints,).
            seconds: Duration in [s] of the robot's time.

        Raises:
            G1DescriptionError: If it is refused, the robot is reset, or the joints do
                not reach the goal.
        """
        positions, now = self.measured_positions(), self.now_ns
        way = minimum_jerk_trajectory(self._names, positions, goal, seconds)
        start_ns, note = self.motions.play(way)
        if note:
            self._notify(f"{note}.")
        end = start_ns + round(1e9 * seconds)
        while now < end:
            before, now = now, self._next(now, timeout=None).stamp
            if now < before:
                self.motions.may_move = False
                raise NoAnswerError(
                    "Time went back during the motion: the robot was reset."
                )
        self.motions.may_move = False  # it need not be stopped afterwards
        self._wait_for_goal(goal)

    def measured_positions(self) -> np.ndarray:
        """Return the current positions of the joints.

        Returns:
            Positions in [rad] or [m] inside the limits, in the order of the movable
            joints, shape (n_joints,).

        Raises:
            NoAnswerError: If joints are not measured.
        """
        shown = self._next(None).positions_by_name
        missing = [name for name in self._names if name not in shown]
        if missing:
            raise NoAnswerError(
                f"{self.topic} lacks the positions of {listed(missing)}."
            )
        joints = self.description.movable_joints
        return np.array(
            [min(max(shown[j.name], j.lower), j.upper) for j in joints], dtype=float
        )

    def _wait_for_goal(
        self, goal: np.ndarray, meanwhile: Callable[[], None] = lambda: None
    ) -> None:
        """Wait until the joints are at the goal.

        Args:
            goal: Positions in [rad] or [m], shape (n_joints,).
            meanwhile: Called repeatedly.

        Raises:
            NoAnswerError: If they do not reach it.
        """
        self.forget_newest()
        positions = dict(zip(self._names, goal))

        def is_there():
            meanwhile()
            return self.state and not self.away(positions, TOLERANCE)

        if self.wait_until(is_there, TIMEOUT):
            return
        if self.state is None:
            raise NoAnswerError(f"The command was sent, but {self.silence}")
        reason = f"; {STANDS_STILL}" if self.stands_still else ""
        raise NoAnswerError(
            f"The robot did not reach the goal within {TIMEOUT:g} s: "
            f"{listed(self.away(positions, TOLERANCE))}{reason}."
        )

    def _next(self, after: int | None, timeout: float | None = TIMEOUT) -> RobotState:
        """Wait for a state.

        Args:
            after: Stamp of the previous state in [ns]; None: return any state.
            timeout: Longest wait in [s]; None: no limit.
        """

        def newer() -> RobotState | None:
            state = self.state
            return state if state and state.stamp != after else None

        state = self.wait_until(newer, timeout)
        if state is None:
            raise NoAnswerError(f"The robot's positions are unknown: {self.silence}")
        return state

    def _leave(self) -> None:
        """Stop the robot if it is moving."""
        try:
            self.motions.leave()
            self.restore_anchor()
        except G1DescriptionError as error:
            self._notify(f"the robot may keep moving: {error}")


DIGITS = 6
"""Decimals of saved positions."""


def list_poses(args: PoseOptions) -> None:
    """Print a line for each pose that fits the robot.

    Raises:
        G1DescriptionError: If the robot or a file of poses cannot be read.
    """
    robot = None
    if args.model is None:
        with suppress(OSError, rosgraph.MasterException):
            parameter = find_parameter(DESCRIPTION, args.namespace)
            robot = read_robot(parameter) if parameter else None
    robot = robot or read_description(args.model or DEFAULT)
    known = read_poses(robot, args.file).values()
    poses = [pose for pose in known if fits(pose, robot)]
    width = max(len(pose.name) for pose in poses)
    for pose in poses:
        print(f"{pose.name:{width}}  {pose.about or pose.place}")
    others = [pose.name for pose in known if pose not in poses]
    if others:
        say(f"pose: not of {robot.name}: {listed(others)}", sys.stderr)


def go(args: PoseOptions) -> None:
    """Move the robot to a pose.

    Raises:
        G1DescriptionError: If there is no such pose, or the robot does not reach it.
    """
    robot = _connect(args)
    pose = find_pose(args.name, read_poses(robot.description, args.file))
    check_pose(pose, robot.description)
    goal = pose_positions(pose, robot.description)
    if args.anchor is not None:
        robot.measured_positions()  # the bridge may have just started
    with robot.anchored(args.anchor):
        if args.seconds:
            robot.move(goal, args.seconds)
        else:
            robot.teleport(goal)
    print(f"pose: {pose.name}")


def save(args: PoseOptions) -> None:
    """Save the robot's current pose.

    Raises:
        G1DescriptionError: If the name is used, or the pose cannot be saved.
    """
    file = (args.file or user_file()).expanduser()
    check_name(args.save)
    robot = _connect(args)
    known = read_poses(robot.description, file if file.exists() else None)
    if args.save in known and not args.force:
        raise PoseFileError(
            f"The pose '{args.save}' already exists in {known[args.save].place}. Use "
            "--force to overwrite it."
        )
    joints = robot.description.movable_joints
    rounded = {
        joint.name: min(max(round(position, DIGITS), joint.lower), joint.upper)
        for joint, position in zip(joints, robot.measured_positions().tolist())
    }
    nonzero = {name: position for name, position in rounded.items() if position}
    save_pose(Pose(args.save, nonzero, args.about), file)
    print(f"pose: {args.save} saved in {file}")


def _connect(args: PoseOptions) -> PosedRobot:
    """Start the node and find the robot."""

    def notify(line):
        say(f"pose: {line}")

    start_node("pose", anonymous=True, disable_rosout=True)
    return PosedRobot(args.namespace, notify)


def main(args: PoseOptions) -> None:
    """Run the command, or exit with a message."""
    act = list_poses if args.list else go if args.save is None else save
    try:
        act(args)
    except (NoAnswerError, RefusedError) as error:
        sys.exit(f"pose: {error}")
    except G1DescriptionError as error:
        exit_with_error("pose", error)
