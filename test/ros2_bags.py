"""MCAP files as others write them: by mcap-ros2-support, with ROS 2's definitions."""

import io

from mcap.writer import CompressionType
from mcap_ros2.writer import Writer

STAMP = "std_msgs/Header header\n"
HEADER = (
    f"\n{'=' * 80}\nMSG: std_msgs/Header\nbuiltin_interfaces/Time stamp\n"
    f"string frame_id\n{'=' * 80}\nMSG: builtin_interfaces/Time\nint32 sec\n"
    "uint32 nanosec"
)
DEFINITIONS = {
    "sensor_msgs/msg/JointState": f"{STAMP}string[] name\nfloat64[] position\n"
    f"float64[] velocity\nfloat64[] effort{HEADER}",
    # Flat, which is the same in CDR.
    "nav_msgs/msg/Odometry": f"{STAMP}string child_frame_id\nfloat64[7] pose\n"
    f"float64[78] others{HEADER}",
    "tf2_msgs/msg/TFMessage": f"Edge[] transforms\n{'=' * 80}\nMSG: tf2_msgs/Edge\n"
    f"{STAMP}string child_frame_id\nfloat64[7] pose{HEADER}",
    "std_msgs/msg/String": "string data",
}


def header(nanoseconds, frame=""):
    seconds, rest = divmod(nanoseconds, 10**9)
    return {"stamp": {"sec": seconds, "nanosec": rest}, "frame_id": frame}


def state(nanoseconds, names, positions):
    """Make joint states, with the name of their type."""
    return "sensor_msgs/msg/JointState", {
        "header": header(nanoseconds),
        "name": [*names],
        "position": [*positions],
        "velocity": [],
        "effort": [],
    }


def odometry(nanoseconds, pose):
    """Make an odometry, with the name of its type."""
    return "nav_msgs/msg/Odometry", {
        "header": header(nanoseconds, "odom"),
        "child_frame_id": "base_link",
        "pose": [*pose],
        "others": [0.0] * 78,
    }


def edge(nanoseconds, pose, parent="map", child="base_link"):
    """Make a TFMessage of one transform, with the name of its type."""
    one = {"header": header(nanoseconds, parent), "child_frame_id": child}
    return "tf2_msgs/msg/TFMessage", {"transforms": [{**one, "pose": [*pose]}]}


def ros2_bag(messages, compression=CompressionType.ZSTD):
    """Make a file of topics, with times of recording in [ns], and messages."""
    stream = io.BytesIO()
    with Writer(stream, chunk_size=5000, compression=compression) as writer:
        schemas = {}
        for topic, time, (kind, message) in messages:
            if kind not in schemas:
                schemas[kind] = writer.register_msgdef(kind, DEFINITIONS[kind])
            writer.write_message(topic, schemas[kind], message, time)
    return stream.getvalue()
