"""A robot behind the topics of a bridge, as a page shows and moves it.

Subscribes, while somebody looks: joint_states, commanded_joint_states
    (sensor_msgs/JointState), /tf, /tf_static (tf2_msgs/TFMessage)
Publishes: joint_commands (sensor_msgs/JointState), base_command
    (geometry_msgs/PoseStamped)
Calls: play_motion (g1_description/PlayMotion)
"""

from __future__ import annotations

import threading
from collections.abc import Mapping

import numpy as np
import rospy
from geometry_msgs.msg import PoseStamped
from sensor_msgs.msg import JointState

from g1_description.bridge.overlays import PREFIX
from g1_description.bridge.parameters import RobotParameters, topic_of
from g1_description.errors import InvalidValueError
from g1_description.robot.assembly import WORLD, base_of
from g1_description.robot.description import Description
from g1_description.robot.state import RobotState
from g1_description.ros.conversions import pose_from_array
from g1_description.ros.lifecycle import quiet_when_closing
from g1_description.ros.log import ThrottledLog
from g1_description.ros.motion_client import MotionClient
from g1_description.ros.robot_states import RESET, JoinedStates
from g1_description.srv import PlayMotion
from g1_description.web.robot import ShownState

PERIOD = 0.01
"""How long messages may gather before they are read, in [s]: a page shows them late by
so much."""

QUEUE_SIZE = 10
"""Commands kept for a slow bridge."""


class LiveRobot:
    """One robot of a bridge."""

    def __init__(
        self,
        parameters: RobotParameters,
        description: Description,
        map_frame: str,
        changed: threading.Event,
    ) -> None:
        """Advertise commands; nothing is subscribed to yet.

        Args:
            parameters: Its names.
            description: The robot.
            map_frame: Frame that is shown.
            changed: To be set when it has moved.
        """
        self.name, self.description = parameters.name, description
        self.joint_topic = rospy.resolve_name(topic_of(parameters, "joint_commands"))
        self._map, self._changed = map_frame, changed
        base = base_of(description)[0]
        prefix = parameters.frame_prefix
        self._joints = frozenset(joint.name for joint in description.movable_joints)
        self._measured = _Follower(
            topic_of(parameters, "joint_states"),
            map_frame if base == WORLD else prefix + base,
        )
        self._wanted = _Follower(
            topic_of(parameters, "commanded_joint_states"),
            map_frame if base == WORLD else PREFIX + prefix + base,
        )
        self._joint_commands = rospy.Publisher(
            self.joint_topic, JointState, queue_size=QUEUE_SIZE, tcp_nodelay=True
        )
        self._base_commands = rospy.Publisher(
            topic_of(parameters, "base_command"),
            PoseStamped,
            queue_size=QUEUE_SIZE,
            tcp_nodelay=True,
        )
        service = topic_of(parameters, "play_motion")
        self.motions = MotionClient(rospy.ServiceProxy(service, PlayMotion))
        """What lets it go through motions."""

    def watch(self, log: ThrottledLog, with_ghost: bool) -> None:
        """Begin to listen."""
        self._measured.open(self._map, log, self._changed)
        if with_ghost:
            self._wanted.open(self._map, log, self._changed)

    def ignore(self) -> None:
        """Stop to listen."""
        self._measured.close()
        self._wanted.close()

    @property
    def now_ns(self) -> int:
        """Time of its newest state, in [ns]; 0 before the first one."""
        return self._measured.stamp

    def look_after_time(self) -> None:
        """Do nothing: the page shows what keeps time from going on."""

    def state(self) -> ShownState | None:
        """Return where it is."""
        return self._read(self._measured.newest())

    def wanted(self) -> ShownState | None:
        """Return the commanded state; None while nobody publishes one."""
        return self._read(self._wanted.newest())

    def _read(self, state: RobotState | None) -> ShownState | None:
        """Leave out joints that are not the robot's, or not finite."""
        if state is None:
            return None
        own = {
            name: position
            for name, position in state.positions_by_name.items()
            if name in self._joints and np.isfinite(position)
        }
        return ShownState(1e-9 * state.stamp, own, state.base_pose)

    def command(self, positions: Mapping[str, float]) -> None:
        """Set joints."""
        message = JointState(name=list(positions), position=list(positions.values()))
        message.header.stamp = rospy.Time.now()
        with quiet_when_closing():
            self._joint_commands.publish(message)

    def command_base(self, pose: np.ndarray) -> None:
        """Put the base somewhere."""
        message = PoseStamped(pose=pose_from_array(pose))
        message.header.frame_id = self._map
        with quiet_when_closing():
            self._base_commands.publish(message)


class _Follower:
    """The newest state on a topic, while somebody wants it."""

    def __init__(self, topic: str, base_frame: str) -> None:
        self._topic, self._base_frame = topic, base_frame
        self._lock = threading.Lock()
        self._states: JoinedStates | None = None
        self._newest: RobotState | None = None
        self._stamp = 0

    def open(self, map_frame: str, log: ThrottledLog, changed: threading.Event) -> None:
        """Begin to listen."""
        states = JoinedStates(map_frame, self._base_frame, PERIOD, log, self._topic)
        with self._lock:
            self._states = states
        states.changed = changed

    def close(self) -> None:
        """Stop to listen; the last state stays until there is another."""
        with self._lock:
            states, self._states = self._states, None
        if states is not None:
            states.close()

    @property
    def stamp(self) -> int:
        """Time of the newest joint states, in [ns], also while nobody looks."""
        with self._lock:
            if self._states is not None:
                self._stamp = self._states.stamp or self._stamp
            return self._stamp

    def newest(self) -> RobotState | None:
        """Return the newest state that has come and can be read."""
        with self._lock:
            try:
                state = None if self._states is None else self._states.newest()
            except InvalidValueError:
                state = None
            # One with a base of its own time may come after a newer one without.
            if state is not None and not 0 < self._behind(state) < RESET:
                self._newest = state
            return self._newest

    def _behind(self, state: RobotState) -> int:
        """Return how much older a state is than the newest one, in [ns]."""
        return 0 if self._newest is None else self._newest.stamp - state.stamp
