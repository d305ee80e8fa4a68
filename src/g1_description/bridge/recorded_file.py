"""Writing motions to files of any format, rosbags included."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, NamedTuple

import genpy
import numpy as np
from sensor_msgs.msg import JointState
from tf2_msgs.msg import TFMessage

from g1_description.bridge.parameters import BridgeParameters, base_child, static_edges
from g1_description.errors import MotionError
from g1_description.files.atomic import whole_file, write_whole
from g1_description.motion.files import formats
from g1_description.motion.files.arrays import MAX_SIZE
from g1_description.motion.files.bag import MAX_MESSAGES
from g1_description.motion.motion import Motion
from g1_description.robot.description import Description
from g1_description.robot.transform import IDENTITY
from g1_description.ros.conversions import stamp_from_ns, transform

if TYPE_CHECKING:
    import rosbag


BAG = ".bag"
ENDINGS = (*formats.WRITTEN, BAG)

MIN_STAMP = 1
"""The first stamp of a bag, in [ns]: zero means no stamp in ROS."""

MAX_STAMP = (1 << 32) * 1_000_000_000 - 1

SPARE = 0.98
"""Fraction of the readable size that is used: a bag also has headers."""


class Room(NamedTuple):
    """The capacity of a file."""

    samples: int
    is_even: bool
    """Whether samples are counted at evenly spaced times."""


def _bag(
    motion: Motion, robot: Description, _: float | None
) -> tuple[bytes, Sequence[str]]:
    """Write a bag as a format is written."""
    with TemporaryDirectory(prefix="g1_bag_") as folder:
        path = Path(folder, "motion.bag")
        _write_bag(path, motion, robot, MIN_STAMP)
        return path.read_bytes(), ()


WRITERS: Mapping[str, formats.Writer] = {
    **formats.WRITERS,
    "bag": formats.Writer(BAG, _bag),
}
"""Formats that can be written, by name, with rosbags."""


def room_of(path: Path, joints: Sequence[str], has_base: bool) -> Room:
    """Find the capacity of a file that can be read again.

    Args:
        path: The file, in the format of its extension.
        joints: Names of the motion's joints.
        has_base: Whether it has a base.

    Raises:
        MotionError: If the format does not support the motion.
    """
    ending = path.suffix.lower()
    if ending != BAG:
        return Room(formats.most_samples(ending, joints, has_base), ending == ".npz")
    n_messages = 2 if has_base else 1
    counts = MAX_MESSAGES / n_messages, MAX_SIZE / (len(joints) or 1)
    return Room(int(SPARE * min(counts)), False)


def write_motion_file(
    path: Path,
    trajectory: Motion,
    robot: Description,
    rate: float | None = None,
    begin: int = MIN_STAMP,
) -> tuple[str, ...]:
    """Write a motion, so that ``read_motion`` reads the same numbers.

    Args:
        path: The file, in the format of its extension; an existing one is replaced.
        trajectory: The motion.
        robot: Whose motion it is.
        rate: Samples per second of an npz, in [Hz]; None: those of the motion.
        begin: Stamp of the first sample, in [ns], which bags have; in a csv it is a
            comment.

    Returns:
        Messages on differences from the motion.

    Raises:
        MotionError: If the format does not support it.
        InvalidValueError: If the file cannot be written.
    """
    if path.suffix.lower() not in ENDINGS:
        raise MotionError(
            f"Unknown format of {path.name}: it must end in {' or '.join(ENDINGS)}."
        )
    if path.suffix.lower() != BAG:
        files, notes = formats.contents(path, trajectory, robot, rate)
        for file, part in files.items():
            if path.suffix.lower() == ".csv" and begin != MIN_STAMP:
                part = f"# time 0 is {1e-9 * begin:.9f} s\n".encode() + part
            write_whole(file, part)
        return notes
    with whole_file(path) as part:
        _write_bag(part, trajectory, robot, begin)
    return ()


def _write_bag(path: Path, trajectory: Motion, robot: Description, begin: int) -> None:
    """Write joint_states, and the base on TF with the same stamps."""
    import rosbag  # takes a third of a second

    t, frames = trajectory, BridgeParameters()
    times = (t.times - t.times[0]).tolist()
    stamps = [begin + round(time * 1e9) for time in times]
    if stamps[-1] > MAX_STAMP:
        raise MotionError(f"The stamp {stamps[-1] / 1e9:g} s is too large for a bag.")
    base = base_child(frames, robot)
    with rosbag.Bag(str(path), "w") as bag:
        _write_static(bag, stamp_from_ns(begin), static_edges(frames, robot))
        for number, stamp in enumerate(map(stamp_from_ns, stamps)):
            velocities = None if t.velocities is None else t.velocities[number]
            state = _joint_state(stamp, t.joint_names, t.positions[number], velocities)
            bag.write("/joint_states", state, stamp)
            if t.base_poses is not None and base is not None:
                pose = t.base_poses[number].tolist()
                edge = transform(stamp, frames.map_frame, base, pose)
                bag.write("/tf", TFMessage([edge]), stamp)


def _write_static(
    bag: rosbag.Bag, stamp: genpy.Time, edges: Sequence[tuple[str, str]]
) -> None:
    """Write the static frames, latched as by their publisher."""
    topic = "/tf_static"
    header = {
        "topic": topic,
        "type": TFMessage._type,
        "md5sum": TFMessage._md5sum,
        "message_definition": TFMessage._full_text,
        "latching": "1",
    }
    message = TFMessage([transform(stamp, *edge, IDENTITY) for edge in edges])
    bag.write(topic, message, stamp, connection_header=header)


def _joint_state(
    stamp: genpy.Time,
    names: Sequence[str],
    positions: np.ndarray,
    velocities: np.ndarray | None,
) -> JointState:
    """Make a message."""
    message = JointState(name=names, position=positions.tolist())
    message.header.stamp = stamp
    if velocities is not None:
        message.velocity = velocities.tolist()
    return message
