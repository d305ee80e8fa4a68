"""The topics and the service for motions of a robot."""

from __future__ import annotations

from functools import partial

import numpy as np
import rospy
from geometry_msgs.msg import PoseStamped
from trajectory_msgs.msg import JointTrajectory

from g1_description.bridge.history import last_positions, motion_text
from g1_description.bridge.parameters import RobotParameters, topic_of
from g1_description.bridge.player import MotionPlayer, Played
from g1_description.bridge.status import RobotStatus
from g1_description.errors import G1DescriptionError, MotionError
from g1_description.motion.motion import Motion
from g1_description.msg import RobotTrajectory
from g1_description.ros.conversions import pose_to_array, stamp_from_ns
from g1_description.ros.log import SHORT_PERIOD, ThrottledLog
from g1_description.ros.map_frame import MapFrame
from g1_description.ros.motion_messages import (
    check_joint_names,
    pose_from_numbers,
    trajectory_from_message,
    whole_body_from_message,
)
from g1_description.srv import (
    PlayMotion,
    PlayMotionRequest,
    PlayMotionResponse,
    SetAnchor,
)

STREAM_QUEUE_SIZE = 10
"""Queued samples of a stream; of more, only the newest are used."""

MAX_LEAD = 60_000_000_000
"""Longest time from now to the start of a motion, in [ns]; a later stamp is from
another clock than the simulator's."""

NEAR_FLOOR = 0.1
"""Height of a base in [m] from which no small step leads below the floor."""

FLOOR_TOLERANCE = 0.01
"""Depth of a base below the floor in [m] above which a warning is logged."""

BUFFER_SIZE = 1 << 20
"""Bytes of a stream that are read at once, so that a backlog is dropped."""


class MotionTopics:
    """Passes the motions of one robot to its player.

    Subscribes: joint_trajectory (trajectory_msgs/JointTrajectory), base_command
        (geometry_msgs/PoseStamped), motion (g1_description/RobotTrajectory)
    Services: play_motion (g1_description/PlayMotion): as motion, with an answer;
        set_anchor (g1_description/SetAnchor) of this robot
    """

    def __init__(
        self,
        robot: RobotParameters,
        status: RobotStatus,
        player: MotionPlayer,
        frame: MapFrame,
        log: ThrottledLog,
    ) -> None:
        self._status, self._player, self._log = status, player, log
        self._map = frame
        joints = status.description.movable_joints
        self._joints = dict.fromkeys(joint.name for joint in joints)
        for name, kind, act, queue_size in (
            # Trajectories may move different joints, so none of them may be lost.
            ("joint_trajectory", JointTrajectory, self._on_joint_trajectory, None),
            ("base_command", PoseStamped, self._on_base_command, STREAM_QUEUE_SIZE),
            (
                "motion",
                RobotTrajectory,
                partial(self._move, stream=True),
                STREAM_QUEUE_SIZE,
            ),
        ):
            rospy.Subscriber(
                topic_of(robot, name),
                kind,
                partial(self._on_message, name, act),
                queue_size=queue_size,
                buff_size=BUFFER_SIZE,
                tcp_nodelay=True,
            )
        rospy.Service(topic_of(robot, "play_motion"), PlayMotion, self._on_call)
        rospy.Service(
            topic_of(robot, "set_anchor"),
            SetAnchor,
            lambda request: player.set_anchor(request.link_name),
        )

    def _on_call(self, request: PlayMotionRequest) -> PlayMotionResponse:
        """Play a motion of joints and base, or stop them."""
        try:
            played = self._move(request.motion)
        except G1DescriptionError as error:
            played = Played(False, str(error))
        self._record("play_motion", request, request.motion, played)
        return PlayMotionResponse(
            played.success, played.message, stamp_from_ns(played.start_ns)
        )

    def _on_message(self, topic: str, act, message) -> None:
        """Apply a message, or log why it was refused."""
        self._status.count(f"{topic} received")
        try:
            played = act(message)
        except G1DescriptionError as error:
            played = Played(False, str(error))
        if not played.success:
            self._status.count(f"{topic} refused")
        self._record(topic, message, message, played)
        if played.message:
            key = f"{topic} {self._status.name}"
            outcome = "" if played.success else "refused: "
            text = f"{topic} of {self._status.name}: {outcome}{played.message}"
            self._log.warn(key, text, SHORT_PERIOD)

    def _record(self, topic: str, message, motion, played: Played) -> None:
        """Keep a message for the history; ``motion`` is its content."""
        joints = motion
        if isinstance(motion, PoseStamped):
            content, joints = "base", JointTrajectory()
        elif isinstance(motion, JointTrajectory):
            content = motion_text(motion)
        else:
            joints = motion.joint_trajectory
            content = motion_text(joints, motion.multi_dof_joint_trajectory)
        positions = last_positions(joints)
        if not played.success:
            content, positions = f"{content}; refused: {played.message}", {}
        self._status.record(message, topic, content, positions)

    def _on_joint_trajectory(self, message: JointTrajectory) -> Played:
        """Play a motion of joints, or stop them."""
        names = message.joint_names
        if not message.points:
            if names:
                check_joint_names(names, self._joints)
            return self._player.stop(names or self._joints)
        motion = trajectory_from_message(message, self._joints)
        return self._play(motion, message.header.stamp, stream=True)

    def _move(self, message: RobotTrajectory, stream: bool = False) -> Played:
        """Play a motion of joints and base, or stop them."""
        motion = whole_body_from_message(message, self._joints, self._map)
        if motion is None:
            return self._player.stop()
        joints, base = message.joint_trajectory, message.multi_dof_joint_trajectory
        header = joints.header if joints.points else base.header
        return self._play(motion, header.stamp, stream)

    def _play(self, motion: Motion, stamp: rospy.Time, stream: bool = False) -> Played:
        """Play a motion.

        Args:
            motion: The motion.
            stamp: When it begins; zero: immediately.
            stream: Whether to play a single configuration without waiting.
        """
        start, now = stamp.to_nsec(), rospy.Time.now().to_nsec()
        late = 1e-9 * (now - start) - motion.end
        is_single = len(motion.times) == 1
        is_configuration = motion.end == 0.0
        if start and late > 0.0 and not is_configuration:
            raise MotionError(f"the motion ended {late:.3f} s ago")
        if start - now > MAX_LEAD:
            lead = 1e-9 * (start - now)
            raise MotionError(
                f"the motion starts in {lead:.0f} s; is its stamp from another clock?"
            )
        if is_configuration and start <= now:
            start = 0
        act = self._player.stream if stream and is_single else self._player.play
        remark = ""
        if motion.base_poses is not None:
            remark = _remark(motion.base_poses[0], self._base if is_single else None)
        return _with(remark, act(motion, start or None))

    def _on_base_command(self, message: PoseStamped) -> Played:
        """Place the robot by its root link."""
        pose = pose_from_numbers(pose_to_array(message.pose))
        header = message.header
        pose = self._map.pose_in_map(pose, header.frame_id, header.stamp)
        remark = _remark(pose, self._base)
        return _with(remark, self._player.place_base(pose))

    @property
    def _base(self) -> np.ndarray | None:
        """Pose of the robot's base in the last state, shape (7,); None if unknown."""
        state = self._status.state
        return None if state is None else state.base_pose


def _remark(pose: np.ndarray, now: np.ndarray | None) -> str:
    """Describe a base pose that looks like a mistake; otherwise return "".

    Args:
        pose: The pose in the map, shape (7,).
        now: The current pose, shape (7,); small steps from it are intended.
    """
    remarks = []
    if _up(pose) < -0.5 and (now is None or _up(now) > 0.0):
        remarks.append("the base is upside down (quaternions are x, y, z, w)")
    if pose[2] < -FLOOR_TOLERANCE and (now is None or now[2] > NEAR_FLOOR):
        remarks.append(f"the base is below the floor, at z = {pose[2]:.3g} m")
    return "; ".join(remarks)


def _up(pose: np.ndarray) -> float:
    """Compute the height of the tip of a base's z axis above its origin."""
    return float(1.0 - 2.0 * (pose[3] ** 2 + pose[4] ** 2))


def _with(remark: str, played: Played) -> Played:
    """Add a remark to the message of a success."""
    if not remark or not played.success:
        return played
    message = "; ".join(filter(None, (played.message, remark)))
    return played._replace(message=message)
