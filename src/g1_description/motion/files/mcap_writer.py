"""Writing motions to MCAP as a ROS 2 robot would be recorded.

The file has the transforms of all links: RViz, Foxglove and rerun draw the robot by
them, without a robot_state_publisher.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import IO, TYPE_CHECKING, Any, Callable

import numpy as np

from g1_description.motion.files.format import BATCH
from g1_description.motion.files.recordings import MIN_STAMP, stamps_of
from g1_description.motion.motion import Motion
from g1_description.robot.assembly import MAP, base_frame, base_of
from g1_description.robot.description import Description, Joint
from g1_description.robot.rotation import from_axis_angle, rotate
from g1_description.robot.transform import IDENTITY, compose

if TYPE_CHECKING:
    from mcap.writer import Writer
    from rosbags.typesys.store import Typestore

MAX_STAMP = (1 << 31) * 1_000_000_000 - 1
"""Largest stamp of ROS 2, in [ns]."""

_ENDLESS = "{sec: 9223372036, nsec: 854775807}"

TRANSIENT_LOCAL = f"""\
- history: 1
  depth: 1
  reliability: 1
  durability: 1
  deadline: {_ENDLESS}
  lifespan: {_ENDLESS}
  liveliness: 1
  liveliness_lease_duration: {_ENDLESS}
  avoid_ros_namespace_conventions: false
"""
"""Quality of service of topics that late subscribers hear: the last message, reliable,
transient local. All releases of ROS 2 read the numbers, only newer ones names."""

_MARKS = ((0, 0.0), (0x01010101, float(np.frombuffer(b"\1" * 8)[0])))
"""Two integers and two numbers that differ in each byte."""

Make = Callable[[int, float], Any]
"""Makes a message whose stamps and numbers all have one value."""


class _Topic:
    """A topic whose messages differ only in stamps and numbers."""

    def __init__(
        self,
        writer: Writer,
        store: Typestore,
        name: str,
        message: tuple[str, Make],
        qos: str = "",
    ) -> None:
        """Add the topic to a file.

        Args:
            writer: The file.
            store: Types of messages.
            name: Name of the topic.
            message: Type of its messages, and what makes one.
            qos: Quality of service in YAML; empty: the usual one.
        """
        kind, make = message
        definition, _ = store.generate_msgdef(kind, ros_version=2)
        schema = writer.register_schema(kind, "ros2msg", definition.encode())
        metadata = {"offered_qos_profiles": qos}
        self._channel = writer.register_channel(name, "cdr", schema, metadata)
        self._writer = writer
        self._blank, marked = (
            np.frombuffer(store.serialize_cdr(make(*mark), kind), dtype=np.uint8)
            for mark in _MARKS
        )
        self._open = self._blank != marked

    def encoded(self, stamps: np.ndarray, numbers: np.ndarray) -> list[bytes]:
        """Encode messages.

        Args:
            stamps: In [ns], shape (n,).
            numbers: Those behind each of their stamps, shape (n, n_stamps, n_numbers).
        """
        size = numbers.shape[-1]
        fields = [("sec", "<i4"), ("nanosec", "<u4"), ("numbers", "<f8", (size,))]
        parts = np.empty(numbers.shape[:2], dtype=fields)
        seconds, rest = np.divmod(stamps, 1_000_000_000)
        parts["sec"], parts["nanosec"] = seconds[:, None], rest[:, None]
        parts["numbers"] = numbers
        rows = np.tile(self._blank, (len(stamps), 1))
        rows[:, self._open] = parts.view(np.uint8).reshape(len(stamps), -1)
        return [row.tobytes() for row in rows]

    def write(self, stamp: int, data: bytes | None = None) -> None:
        """Write a message; without data, the one with zeros."""
        content = self._blank.tobytes() if data is None else data
        self._writer.add_message(self._channel, stamp, content, stamp)


def write_mcap(
    stream: IO[bytes], motion: Motion, robot: Description, begin: int = MIN_STAMP
) -> None:
    """Write joint_states, the base and all links on TF, and robot_description.

    Args:
        stream: Where the file is written.
        motion: The motion.
        robot: The robot that moves. Links below joints that the motion lacks have no
            transforms.
        begin: Stamp of the first sample, in [ns].

    Raises:
        MotionError: If a stamp is too large.
    """
    from mcap.writer import Writer
    from rosbags.typesys import Stores, get_typestore

    stamps = stamps_of(motion, begin, MAX_STAMP)
    store = get_typestore(Stores.ROS2_HUMBLE)
    writer = Writer(stream)
    writer.start("ros2")
    if robot.urdf:
        text = _text(store, robot.urdf)
        _Topic(writer, store, "/robot_description", text, TRANSIENT_LOCAL).write(begin)
    static = _static_transforms(robot)
    if static:
        tf = _Topic(writer, store, "/tf_static", _tf(store, [*static]), TRANSIENT_LOCAL)
        data = tf.encoded(np.array([begin]), np.array([[*static.values()]]))
        tf.write(begin, *data)
    column = {name: column for column, name in enumerate(motion.joint_names)}
    joints = [joint for joint in robot.movable_joints if joint.name in column]
    base = base_frame(robot)
    bases = None if base is None else motion.base_poses
    transforms = [(joint.parent, joint.child) for joint in joints]
    transforms += [] if bases is None else [(MAP, str(base))]
    states = _Topic(writer, store, "/joint_states", _joint_state(store, motion))
    moving = (
        _Topic(writer, store, "/tf", _tf(store, transforms)) if transforms else None
    )
    for first in range(0, len(stamps), BATCH):
        part = slice(first, first + BATCH)
        times = np.array(stamps[part])
        positions = motion.positions[part]
        velocities = [] if motion.velocities is None else [motion.velocities[part]]
        numbers = np.concatenate([positions, *velocities], axis=1)[:, None]
        poses = [_pose(joint, positions[:, column[joint.name]]) for joint in joints]
        poses += [] if bases is None else [bases[part]]
        topics = [(states, states.encoded(times, numbers))]
        if moving is not None:
            topics.append((moving, moving.encoded(times, np.stack(poses, axis=1))))
        for row, stamp in enumerate(stamps[part]):
            for topic, messages in topics:
                topic.write(stamp, messages[row])
    writer.finish()


def _static_transforms(robot: Description) -> dict[tuple[str, str], np.ndarray]:
    """Return the poses of fixed joints, and of the root in the base's frame."""
    found = {(j.parent, j.child): j.pose for j in robot.joints if j.kind == "fixed"}
    base, (root, _) = base_frame(robot), base_of(robot)
    return found if base in (None, root) else {**found, (str(base), root): IDENTITY}


def _pose(joint: Joint, positions: np.ndarray) -> np.ndarray:
    """Place a joint's child in its parent, shape (n, 7).

    Args:
        joint: A movable joint.
        positions: In [rad] or [m], shape (n,).
    """
    moved = np.tile(IDENTITY, (len(positions), 1))
    if joint.kind == "prismatic":
        moved[:, :3] = positions[:, None] * joint.axis
    else:
        moved[:, 3:] = from_axis_angle(joint.axis, positions)
        moved[:, :3] = joint.joint_origin - rotate(moved[:, 3:], joint.joint_origin)
    return compose(joint.pose, moved)


def _text(store: Typestore, text: str) -> tuple[str, Make]:
    """Return how a text is made."""
    kind = "std_msgs/msg/String"
    return kind, lambda *_: store.types[kind](data=text)


def _header(store: Typestore, frame: str, stamp: int) -> Any:
    """Make a header."""
    time = store.types["builtin_interfaces/msg/Time"](sec=stamp, nanosec=stamp)
    return store.types["std_msgs/msg/Header"](stamp=time, frame_id=frame)


def _joint_state(store: Typestore, motion: Motion) -> tuple[str, Make]:
    """Return how a JointState is made."""
    kind, count = "sensor_msgs/msg/JointState", len(motion.joint_names)
    n_velocities = 0 if motion.velocities is None else count

    def make(stamp: int, number: float) -> Any:
        return store.types[kind](
            header=_header(store, "", stamp),
            name=[*motion.joint_names],
            position=np.full(count, number),
            velocity=np.full(n_velocities, number),
            effort=np.empty(0),
        )

    return kind, make


def _tf(store: Typestore, transforms: Sequence[tuple[str, str]]) -> tuple[str, Make]:
    """Return how a TFMessage is made."""
    kind, types = "tf2_msgs/msg/TFMessage", store.types

    def make(stamp: int, number: float) -> Any:
        pose = types["geometry_msgs/msg/Transform"](
            translation=types["geometry_msgs/msg/Vector3"](*[number] * 3),
            rotation=types["geometry_msgs/msg/Quaternion"](*[number] * 4),
        )
        edge = types["geometry_msgs/msg/TransformStamped"]
        return types[kind](
            transforms=[
                edge(_header(store, parent, stamp), child, pose)
                for parent, child in transforms
            ]
        )

    return kind, make
