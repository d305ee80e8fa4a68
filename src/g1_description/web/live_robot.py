"""A robot of a bridge, as shown and moved by a page.

Subscribes, while the page is open: robot_state, or else joint_states and TF, as
    ros.robot_states.RobotStates
Publishes: joint_commands (sensor_msgs/JointState), base_command
    (geometry_msgs/PoseStamped), motion (g1_description/RobotTrajectory)
Calls: play_motion (g1_description/PlayMotion), set_anchor (g1_description/SetAnchor),
    get_history (g1_description/GetHistory), get_anchor of the simulator
    (g1_description/GetAnchor)
"""

from __future__ import annotations

import threading
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import replace
from functools import partial

import numpy as np
import rospy
from geometry_msgs.msg import PoseStamped
from sensor_msgs.msg import JointState

from g1_description.bridge.parameters import RobotParameters, topic_of
from g1_description.errors import InvalidValueError
from g1_description.msg import RobotTrajectory
from g1_description.robot.assembly import WORLD, base_of
from g1_description.robot.description import Description
from g1_description.robot.state import RobotState
from g1_description.ros.conversions import pose_from_array
from g1_description.ros.history import HistoryClient
from g1_description.ros.lifecycle import quiet_when_closing
from g1_description.ros.log import ThrottledLog
from g1_description.ros.motion_messages import configuration_message
from g1_description.ros.playing import MotionClient, set_anchor
from g1_description.ros.robot_states import RobotStates
from g1_description.ros.waiting import SERVICE_ERRORS
from g1_description.srv import GetAnchor, PlayMotion, SetAnchor
from g1_description.web.live_simulator import LiveSimulator

PERIOD = 0.01
"""Polling period of messages, in [s], which adds to the latency."""


class LiveRobot:
    """One robot of a bridge."""

    def __init__(
        self,
        parameters: RobotParameters,
        description: Description,
        map_frame: str,
        changed: threading.Event,
        simulator: LiveSimulator | None,
    ) -> None:
        self.name, self.description = parameters.name, description
        self._map, self._changed = map_frame, changed
        base = base_of(description)[0]
        prefix = parameters.frame_prefix
        self._joints = frozenset(joint.name for joint in description.movable_joints)
        self._base_frame = map_frame if base == WORLD else prefix + base
        self._lock = threading.Lock()
        self._states: RobotStates | None = None
        self._newest: RobotState | None = None
        self._stamp = 0
        topic = partial(topic_of, parameters)
        self._joint_states = topic("joint_states")
        publisher = partial(rospy.Publisher, queue_size=10, tcp_nodelay=True)
        self._joint_commands = publisher(topic("joint_commands"), JointState)
        self._base_commands = publisher(topic("base_command"), PoseStamped)
        self._motions = publisher(topic("motion"), RobotTrajectory)
        self.motions = MotionClient(
            rospy.ServiceProxy(topic("play_motion"), PlayMotion)
        )
        """Client of the service that plays motions."""
        self.anchor = ""
        """Its anchor when the page was opened, or as set on the page since."""
        self._set_anchor = rospy.ServiceProxy(topic("set_anchor"), SetAnchor)
        self._simulator = simulator
        self.history: HistoryClient | None = HistoryClient(topic("get_history"))

    def watch(self, log: ThrottledLog) -> None:
        """Subscribe."""
        states = RobotStates(
            self._map,
            self._base_frame,
            PERIOD,
            log,
            self._joint_states,
            self._changed,
        )
        with self._lock:
            self._states = states
        if self._simulator is not None:
            get_anchor = rospy.ServiceProxy(
                f"{self._simulator.name}/get_anchor", GetAnchor
            )
            with suppress(*SERVICE_ERRORS):  # the real Gazebo has no anchors
                self.anchor = get_anchor(self.name).link_name

    def ignore(self) -> None:
        """Unsubscribe; the last state is kept."""
        with self._lock:
            states, self._states = self._states, None
        if states is not None:
            states.close()

    @property
    def has_anchors(self) -> bool:
        """Whether an anchor can be set."""
        return self._simulator is not None and self._simulator.is_stand_in

    @property
    def now_ns(self) -> int:
        """Time of the newest state, in [ns]; 0: none yet."""
        with self._lock:
            if self._states is not None:
                self._stamp = self._states.stamp or self._stamp
            return self._stamp

    def look_after_time(self) -> None:
        """Do nothing: the page shows whether time is paused."""

    def state(self) -> RobotState | None:
        """Return the newest valid state, with the robot's joints only."""
        with self._lock:
            try:
                state = None if self._states is None else self._states.newest()
            except InvalidValueError:
                state = None
            if state is not None:
                self._newest = self._own(state)
            return self._newest

    def _own(self, state: RobotState) -> RobotState:
        """Remove unknown joints, and positions that are not finite."""
        rows = [
            row
            for row, name in enumerate(state.names)
            if name in self._joints and np.isfinite(state.positions[row])
        ]
        return replace(
            state,
            names=tuple(state.names[row] for row in rows),
            positions=state.positions[rows],
            velocities=None if state.velocities is None else state.velocities[rows],
            efforts=None if state.efforts is None else state.efforts[rows],
            commanded={
                name: position
                for name, position in state.commanded.items()
                if name in self._joints and np.isfinite(position)
            },
        )

    def command(self, positions: Mapping[str, float]) -> None:
        """Command positions of joints."""
        message = JointState(name=list(positions), position=list(positions.values()))
        message.header.stamp = rospy.Time.now()
        with quiet_when_closing():
            self._joint_commands.publish(message)

    def command_base(self, pose: np.ndarray) -> None:
        """Command the pose of the base."""
        message = PoseStamped(pose=pose_from_array(pose))
        message.header.frame_id = self._map
        with quiet_when_closing():
            self._base_commands.publish(message)

    def command_all(self, positions: Mapping[str, float], base: np.ndarray) -> None:
        """Command positions of joints and the pose of the base in one message."""
        with quiet_when_closing():
            self._motions.publish(configuration_message(positions, base))

    def set_anchor(self, link: str) -> None:
        """Set the link that stays at its place while joints move.

        Raises:
            G1DescriptionError: If it is refused, or the bridge does not answer.
        """
        set_anchor(self._set_anchor, link)
        self.anchor = link
