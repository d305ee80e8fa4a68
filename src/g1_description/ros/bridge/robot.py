"""One robot of the bridge: its topics, its frames and what is wrong with it."""

from __future__ import annotations

import posixpath
import threading
import time
from functools import cached_property

import genpy
import rospy
from geometry_msgs.msg import TransformStamped
from sensor_msgs.msg import JointState

from g1_description.core.bridge.command_tally import CommandTally
from g1_description.core.bridge.commands import listed, split_command
from g1_description.core.bridge.observer import Share, Sight
from g1_description.core.bridge.throttle import PoseThrottle
from g1_description.core.bridge.whole_states import State, WholeStates
from g1_description.core.errors import DescriptionError
from g1_description.core.robot.description import FREE, Description
from g1_description.core.robot.lumping import lump_fixed_joints
from g1_description.ros.node.complaints import Complaints
from g1_description.ros.transport.direct_publisher import DirectPublisher
from g1_description.ros.wire.conversions import stamp_from_ns, transform
from g1_description.ros.wire.joint_states import JointStateEncoder, PreparedJointState

from .frames import base_child
from .parameters import BridgeParameters, RobotParameters
from .sender import CommandCount, CommandSender

QUEUE = 10_000
"""Joint states kept for a slow subscriber: a script that steps may be seconds ahead of
what it hears, and shall hear of each step."""

TF_QUEUE = 100

TF_INTERVAL = 20_000_000
"""Joint states go to TF at least so often, in [ns]: 50 Hz, as robot_state_publisher
does it by itself."""

START = 5.0
"""A robot may be spawned this long after the bridge began, in [s]."""


class BridgedRobot:
    """What comes in and goes out for one robot."""

    _unsent: PreparedJointState | None = None
    """What a robot without a base has not sent to TF yet."""

    def __init__(
        self,
        robot: RobotParameters,
        description: Description,
        parameters: BridgeParameters,
        complaints: Complaints,
    ) -> None:
        """Advertise its joint states.

        Args:
            robot: Its names.
            description: The robot as its file tells it.
            parameters: The node's parameters.
            complaints: Where to tell what is wrong.
        """
        self.name = robot.name
        self.description = description
        self.namespace = robot.namespace
        self._map_frame = parameters.map_frame
        self._complaints = complaints
        base = base_child(parameters, description)
        self._base = base and robot.frame_prefix + base
        limits = {j.name: (j.lower, j.upper) for j in description.movable_joints}
        self.tally = CommandTally(limits)
        """What of its commands is clamped or ignored."""
        self._movable = frozenset(limits)
        # rospy has a thread for each publisher of commands.
        self._counting = threading.Lock()
        self._throttle = PoseThrottle(
            parameters.position_threshold,
            parameters.rotation_threshold,
            parameters.max_interval,
            parameters.min_interval,
        )
        self._whole_states = WholeStates()
        self._commands = CommandCount()
        self._encoder = JointStateEncoder()
        self.joint_states = DirectPublisher(
            self._topic("joint_states"), PreparedJointState, QUEUE, latch=True
        )
        self.tf_joint_states = DirectPublisher(
            self._topic("tf_joint_states"), PreparedJointState, TF_QUEUE, latch=True
        )
        self._tf_stamp = -TF_INTERVAL
        self.share: Share | None = None
        """What the last message had of it."""
        self.off_axis: dict[str, float] = {}
        """Rotation left over off the axis in [rad] by joint, in the last message."""
        self.ignored: tuple[float, str] | None = None
        """When something of a command was last ignored, on the monotonic clock, and
        why."""
        self.other_publishers: list[str] = []
        """Other nodes that publish its joint states."""
        self._began, self._may_be_late = time.monotonic(), True
        self._tell_what_is_left_out()

    def _topic(self, name: str) -> str:
        """Name a topic of the robot."""
        return posixpath.join(self.namespace and f"/{self.namespace}", name)

    def listen(self, sender: CommandSender) -> None:
        """Take commands from now on, and let a sender send them."""
        self._commands = sender.counts[self.name]

        def came(message: JointState) -> None:
            names, positions = message.name, message.position
            with self._counting:
                self.tally.count(names, positions, time.monotonic())
            accepted, complaints = split_command(names, positions, self._movable)
            if complaints:
                self.ignored = time.monotonic(), "; ".join(complaints)
                told = f"Of a joint command to {self.name} is ignored"
                self._complaints.tell(
                    f"command {self.name}", f"{told}: {self.ignored[1]}.", 1.0
                )
            if accepted:
                sender.put(self.name, accepted)

        # Messages may name different joints, so none of them may be lost.
        topic = self._topic("joint_commands")
        rospy.Subscriber(topic, JointState, came, queue_size=None, tcp_nodelay=True)

    def publish(
        self, stamp: genpy.Time, sight: Sight, share: Share, again: bool = False
    ) -> TransformStamped | None:
        """Publish what a message tells of the robot.

        Args:
            stamp: The message's time.
            sight: What it tells of all robots.
            share: This robot's share of it.
            again: Whether it was published before, and only TF shall have it again.

        Returns:
            Its base in the map in the state before this one, if that is worth sending.
        """
        if share is not self.share:
            self._tell_that_it_came(share)
            self.share = share
            self.off_axis = {}
        if share.joints.missing or share.broken or not share.is_there:
            self._tell_what_is_missing(share)
        if sight.off_axis or self.off_axis:
            self._tell_what_is_off_axis(sight, share)
        if not share.is_there:
            self._whole_states.reset()
            self.joint_states.forget()
            self.tf_joint_states.forget()
            return None
        self._may_be_late = False
        message = self._encode(stamp, sight, share)
        if not again:
            self.joint_states.publish(message)
        pose = sight.base_pose(share)
        if self._base is None or pose is None:
            is_due = not 0 <= stamp.to_nsec() - self._tf_stamp < TF_INTERVAL
            self._unsent = None if is_due else message
            if is_due:
                self.tf_joint_states.publish(message)
                self._tf_stamp = stamp.to_nsec()
            return None
        self._unsent = None
        joints = sight.measured.position[share.span]
        is_moving = bool(sight.measured.velocity[share.span].any())
        state = State(stamp.to_nsec(), pose, joints, message, is_moving)
        count = self._commands
        whole = self._whole_states.next(
            state, time.monotonic(), count.came, count.came > count.answered
        )
        return whole and self._show(whole)

    def settle(self) -> TransformStamped | None:
        """Show the last state on TF, if no other follows and it is not there.

        Returns:
            Its base in the map, if that was not sent.
        """
        if self._unsent is not None:
            self.tf_joint_states.publish(self._unsent)
            self._unsent = None
        state = self._whole_states.held
        return state and self._show(state, is_last=True)

    def _show(self, state: State, is_last: bool = False) -> TransformStamped | None:
        """Show a state on TF, if it is worth it.

        Where TF has the base and the joints of one state it interpolates neither. So
        the joints go there with each base, and by themselves, where they are due, as
        long as the base stands still.

        Args:
            state: The state.
            is_last: Whether no other follows.

        Returns:
            Its base in the map, if that is to be sent.
        """
        pose, age = state.pose.tolist(), state.stamp - self._tf_stamp
        is_due = is_last or (age >= TF_INTERVAL and self._throttle.is_near(pose))
        passes = self._throttle.settles if is_last else self._throttle.passes
        with_base = passes(1e-9 * state.stamp, pose)
        if age > 0 and (with_base or is_due):
            self.tf_joint_states.publish(state.message)
            self._tf_stamp = state.stamp
        if not with_base:
            return None
        stamp = stamp_from_ns(state.stamp)
        return transform(stamp, self._map_frame, self._base, pose)

    def _encode(
        self, stamp: genpy.Time, sight: Sight, share: Share
    ) -> PreparedJointState:
        """Make the robot's joint states."""
        measured, span = sight.measured, share.span
        return self._encoder.encode(
            stamp,
            share.joints.names,
            measured.position[span],
            measured.velocity[span],
        )

    def flush(self) -> None:
        """Send slow subscribers what is kept for them."""
        self.joint_states.flush()
        self.tf_joint_states.flush()

    def reset(self) -> None:
        """Take it that time began again, or that nobody knows what was sent."""
        self._throttle.reset()
        self._whole_states.reset()
        self._tf_stamp, self._unsent = -TF_INTERVAL, None

    @cached_property
    def vanishes(self) -> bool:
        """Whether Gazebo leaves nothing of it."""
        try:
            return not lump_fixed_joints(self.description).link_names
        except DescriptionError:
            return False

    def _tell_that_it_came(self, share: Share) -> None:
        """Say that the robot is there, after it was not."""
        if share.is_there and not (self.share and self.share.is_there):
            told = (
                f"{self.name} is there, {len(share.joints.names)} joints are measured."
            )
            self._complaints.tell(f"came {self.name}", told, 1.0, rospy.loginfo)

    def _tell_what_is_left_out(self) -> None:
        """Say which joints have more than one degree of freedom."""
        joints = self.description.joints
        found = [f"{j.name} ({j.kind})" for j in joints if j.kind in FREE]
        if found:
            rospy.logwarn(
                "Joints of %s are left out, they have no single position: %s.",
                self.name,
                ", ".join(found),
            )

    def _tell_what_is_missing(self, share: Share) -> None:
        """Say which links cannot be seen."""
        if self._may_be_late and time.monotonic() - self._began < START:
            return
        if share.broken:
            why = f"no usable numbers for {listed(share.broken)}"
        elif share.is_there:
            why = f"no link {listed(share.joints.missing)}"
        elif self.vanishes:
            why = (
                "no link of it: nothing is left where links without mass are dropped, "
                "with all that hangs on them"
            )
        else:
            why = "no link of it (is it spawned under this name?)"
        self._complaints.tell(
            f"missing {self.name}",
            f"Joints of {self.name} are left out, the simulator has {why}.",
            stands=True,
        )

    def _tell_what_is_off_axis(self, sight: Sight, share: Share) -> None:
        """Say which joints do not keep to their axes."""
        self.off_axis = sight.off_axis_joints(share)
        if self.off_axis:
            angles = listed(
                f"{name} by {angle:.3g} rad" for name, angle in self.off_axis.items()
            )
            self._complaints.tell(
                f"off axis {self.name}",
                f"Joints of {self.name} are turned off their axes: {angles}. Is its "
                "robot_description the one that was spawned?",
            )
