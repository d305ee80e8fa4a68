"""Writing motions to rosbags."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import genpy
import rosbag
from sensor_msgs.msg import JointState
from tf2_msgs.msg import TFMessage

from g1_description.bridge.parameters import BridgeParameters, base_child, static_edges
from g1_description.motion.files.recordings import stamps_of
from g1_description.motion.motion import Motion
from g1_description.robot.description import Description
from g1_description.robot.transform import IDENTITY
from g1_description.ros.conversions import stamp_from_ns, transform

MAX_STAMP = (1 << 32) * 1_000_000_000 - 1


def write_bag(path: Path, motion: Motion, robot: Description, begin: int) -> None:
    """Write joint_states, and the base on TF with the same stamps."""
    t, frames = motion, BridgeParameters()
    stamps = stamps_of(motion, begin, MAX_STAMP)
    base = base_child(frames, robot)
    with rosbag.Bag(str(path), "w") as bag:
        _write_static(bag, stamp_from_ns(begin), static_edges(frames, robot))
        for number, stamp in enumerate(map(stamp_from_ns, stamps)):
            positions = t.positions[number].tolist()
            state = JointState(name=t.joint_names, position=positions)
            state.header.stamp = stamp
            if t.velocities is not None:
                state.velocity = t.velocities[number].tolist()
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
