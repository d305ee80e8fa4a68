"""One robot of the bridge: its joint states, its base on TF, and its warnings."""

from __future__ import annotations

import time

import numpy as np
import rospy
from geometry_msgs.msg import TransformStamped

from g1_description.bridge.commands import JointCommands
from g1_description.bridge.estimator import Observation
from g1_description.bridge.overlays import Extras
from g1_description.bridge.parameters import (
    BridgeParameters,
    RobotParameters,
    base_child,
    topic_of,
)
from g1_description.bridge.player import MotionPlayer
from g1_description.bridge.status import RobotStatus
from g1_description.bridge.tf_filter import PoseThrottle, Shown, State, TfFilter
from g1_description.robot.description import FREE
from g1_description.robot.state import RobotState
from g1_description.ros.conversions import stamp_from_ns, transform
from g1_description.ros.log import SHORT_PERIOD, ThrottledLog
from g1_description.ros.publisher import DirectPublisher
from g1_description.ros.wire import (
    JointStateEncoder,
    PreparedJointState,
    PreparedRobotState,
)
from g1_description.text import listed

QUEUE_SIZE = 10_000
"""Joint states kept for a slow subscriber: a script that steps the simulator may be
seconds ahead of its own subscriber, which must get the states of each step."""

TF_QUEUE_SIZE = 100
"""Joint states kept for a slow robot_state_publisher; older ones are useless on TF."""


class BridgedRobot:
    """Publishes the observations of one robot."""

    _unsent: PreparedJointState | None = None
    """Last message that TF has not got, of a robot without a base."""

    def __init__(
        self,
        robot: RobotParameters,
        parameters: BridgeParameters,
        status: RobotStatus,
        log: ThrottledLog,
    ) -> None:
        """Advertise its joint states.

        Args:
            robot: Its names.
            parameters: The node's parameters.
            status: Where to keep the last observation.
            log: Where to log what is wrong.
        """
        self.status = status
        self.commands = JointCommands(
            parameters.gazebo, status.name, status.commands, log
        )
        """What sends its commands."""
        self.player = MotionPlayer(parameters.gazebo, status, self.commands)
        """What plays its motions."""
        self._warnings = RobotWarnings(status, log)
        self._map_frame = parameters.map_frame
        base = base_child(parameters, status.description)
        self._base = base and robot.frame_prefix + base
        self._tf_filter = TfFilter(
            PoseThrottle(
                parameters.position_threshold,
                parameters.rotation_threshold,
                parameters.max_interval,
                parameters.min_interval,
            )
        )
        self._extras = Extras(robot, parameters, status.description, self.player)
        self._encoder = JointStateEncoder()
        self._joint_states = DirectPublisher(
            topic_of(robot, "joint_states"), PreparedJointState, QUEUE_SIZE, latch=True
        )
        self._robot_states = DirectPublisher(
            topic_of(robot, "robot_state"), PreparedRobotState, QUEUE_SIZE, latch=True
        )
        self._tf_joint_states = DirectPublisher(
            topic_of(robot, "tf_joint_states"),
            PreparedJointState,
            TF_QUEUE_SIZE,
            latch=True,
        )

    @property
    def topic(self) -> str:
        """Full name of the topic of its joint states."""
        return self._joint_states.name

    def publish(
        self, stamp: int, seen: Observation, time_ns: int
    ) -> TransformStamped | None:
        """Publish an observation.

        Args:
            stamp: What it is published under, in [ns].
            seen: The observation.
            time_ns: When it was so, in [ns]: other stamps where time stands still.

        Returns:
            The base in the map in the state before this one, if that is worth sending.
        """
        is_sample = False
        if not self.player.is_idle:
            is_sample = self.player.observe(time_ns, seen)
        self.status.observation, self.status.stamp = seen, time_ns
        is_whole = seen.is_present and not (seen.missing or seen.invalid)
        if seen.changed or seen.axis_residual or not is_whole:
            self._warnings.check(seen)
        if not seen.is_present:
            self._tf_filter.drop()
            self._joint_states.forget()
            self._robot_states.forget()
            self._tf_joint_states.forget()
            return None
        if self._extras.are_wanted:
            self._extras.show(time_ns, seen)
        message = self._encode(stamp, seen)
        self._joint_states.publish(message)
        self._robot_states.publish(
            PreparedRobotState(self._state(stamp, seen), self._map_frame)
        )
        return self._send_to_tf(stamp, seen, message, is_sample)

    def publish_again(self, stamp: int) -> None:
        """Send the last observation to TF once more, for a new listener.

        Args:
            stamp: What it is sent under, in [ns].
        """
        self.reset()
        seen = self.status.observation
        if seen is not None and seen.is_present:
            self._send_to_tf(stamp, seen, self._encode(stamp, seen))

    def _encode(self, stamp: int, seen: Observation) -> PreparedJointState:
        """Write an observation as joint states."""
        return self._encoder.encode(stamp, seen.names, seen.position, seen.velocity)

    def _state(self, stamp: int, seen: Observation) -> RobotState:
        """Convert an observation; commands are known where they are kept."""
        commanded, commanded_base = {}, None
        if self.player.keeps_commands:
            wanted = self.player.wanted
            pairs = zip(self.player.joint_names, wanted.positions.tolist())
            commanded = {name: p for name, p in pairs if not np.isnan(p)}
            if not np.isnan(wanted.base_pose).any():
                commanded_base = wanted.base_pose.copy()
        has_base = self._base is not None
        return RobotState(
            stamp,
            seen.names,
            seen.position,
            seen.velocity,
            seen.base_pose if has_base else None,
            seen.base_twist if has_base else None,
            commanded,
            commanded_base,
        )

    def _send_to_tf(
        self,
        stamp: int,
        seen: Observation,
        message: PreparedJointState,
        is_sample: bool = False,
    ) -> TransformStamped | None:
        """Send an observation to TF where it is due.

        Args:
            stamp: What it is sent under, in [ns].
            seen: The observation.
            message: The same as joint states.
            is_sample: Whether a sample of a motion has just come.

        Returns:
            The base in the map in the state before this one, if that is worth sending.
        """
        if self._base is None or seen.base_pose is None:
            self._send_without_base(stamp, message)
            return None
        self._unsent = None
        is_moving = bool(seen.velocity.any())
        state = State(
            stamp, seen.base_pose, seen.position, message, is_moving, is_sample
        )
        count = self.status.commands
        is_under_way = count.received > count.answered
        shown = self._tf_filter.next(
            state, time.monotonic(), count.received, is_under_way
        )
        return shown and self._show(shown)

    def _send_without_base(self, stamp: int, message: PreparedJointState) -> None:
        """Send joint states to TF where they are due, keep them otherwise."""
        self._unsent = message
        if self._tf_filter.passes_without_base(stamp):
            self._send_unsent()

    def _send_unsent(self) -> None:
        """Send the joint states that were kept to TF."""
        self._tf_joint_states.publish(self._unsent)
        self._unsent = None

    def settle(self) -> TransformStamped | None:
        """Show the last state on TF, if no other follows and it is not there.

        Returns:
            Its base in the map, if that was not sent.
        """
        if self._unsent is not None:
            self._send_unsent()
        shown = self._tf_filter.settle()
        return shown and self._show(shown)

    def _show(self, shown: Shown) -> TransformStamped | None:
        """Send a state's joints to TF; return its base in the map if that goes too."""
        state = shown.state
        if shown.with_joints:
            self._tf_joint_states.publish(state.message)
        if not shown.with_base:
            return None
        stamp, pose = stamp_from_ns(state.stamp), state.pose.tolist()
        return transform(stamp, self._map_frame, self._base, pose)

    def flush(self) -> None:
        """Send slow subscribers the messages that are kept for them."""
        self.player.flush()
        self._joint_states.flush()
        self._robot_states.flush()
        self._tf_joint_states.flush()
        self.status.tf_listeners = self._tf_joint_states.get_num_connections()

    def begin_again(self) -> None:
        """Forget everything: time began again."""
        self.reset()
        self.player.reset()
        self._extras.reset()

    def reset(self) -> None:
        """Forget what was sent to TF: time began again, or a listener is new."""
        self._tf_filter.reset()
        self._unsent = None


class RobotWarnings:
    """Logs what is wrong with the observations of one robot."""

    def __init__(self, status: RobotStatus, log: ThrottledLog) -> None:
        """Log which joints have more than one degree of freedom.

        Args:
            status: The robot.
            log: Where to log what is wrong.
        """
        self._status, self._log = status, log
        self._was_present = self._came = False
        joints = status.description.joints
        found = [f"{j.name} ({j.kind})" for j in joints if j.kind in FREE]
        if found:
            rospy.logwarn(
                "Joints of %s are left out, they have no single position: %s.",
                status.name,
                ", ".join(found),
            )

    def check(self, seen: Observation) -> None:
        """Log what is new or wrong in an observation."""
        if seen.is_present and not self._was_present:
            self._log_arrival(seen)
        if seen.missing or seen.invalid or not seen.is_present:
            self._warn_of_missing_links(seen)
        if seen.axis_residual:
            self._warn_of_rotated_joints(seen)
        self._was_present = seen.is_present
        self._came = self._came or seen.is_present

    def _log_arrival(self, seen: Observation) -> None:
        """Log that the robot is there, after it was not."""
        name = self._status.name
        text = f"{name} is there, {len(seen.names)} joints are measured."
        self._log.warn(f"came {name}", text, SHORT_PERIOD, rospy.loginfo)

    def _warn_of_missing_links(self, seen: Observation) -> None:
        """Warn that joints are left out as their links are unknown."""
        if self._status.is_in_grace and not self._came:
            return
        if seen.invalid:
            reason = f"no usable numbers for {listed(seen.invalid)}"
        elif seen.is_present:
            reason = f"no link {listed(seen.missing)}"
        elif self._status.vanishes:
            reason = (
                "no link of it: it drops links without mass, and all that hangs on "
                "them, and nothing is left"
            )
        else:
            reason = "no link of it (is it spawned under this name?)"
        name = self._status.name
        self._log.warn(
            f"missing {name}",
            f"Joints of {name} are left out, the simulator has {reason}.",
            lasts=True,
        )

    def _warn_of_rotated_joints(self, seen: Observation) -> None:
        """Warn that joints do not keep to their axes."""
        name, residual = self._status.name, seen.axis_residual
        angles = (f"{joint} by {angle:.3g} rad" for joint, angle in residual.items())
        self._log.warn(
            f"off axis {name}",
            f"Joints of {name} are turned off their axes: {listed(angles)}. Is its "
            "robot_description the one that was spawned?",
        )
