"""MCAP: written ones as other libraries read them, and those of others."""

import io

import numpy as np
import pytest
from mcap.records import Schema
from mcap.writer import CompressionType, Writer
from mcap_ros2.decoder import DecoderFactory
from ros2_bags import edge, odometry, ros2_bag, state
from rosbags.interfaces import Connection
from rosbags.rosbag2.storage_mcap import MCAPFile
from rosbags.typesys import Stores, get_typestore
from test_motion_writing import G1, assert_same, trajectory

from g1_description.bridge.recorded_file import write_motion_file
from g1_description.errors import MotionError
from g1_description.motion.files.formats import read_motion, write_motion
from g1_description.motion.files.source import ReadOptions
from g1_description.robot.kinematics import Kinematics
from g1_description.robot.transform import compose

SECOND = 1_000_000_000
KNEE = "left_knee_joint"
PLACE = (1.0, 2.0, 3.0, 0.0, 0.0, 0.0, 1.0)


class Witness:
    """A file as other libraries read it: rosbags the container, mcap-ros2 messages."""

    def __init__(self, path):
        file = MCAPFile(path)
        file.open()
        schemas = {one.id: one for one in file.schemas.values()}
        self.types = {one.topic: one.schema for one in file.channels.values()}
        self.qos = {one.topic: one.metadata for one in file.channels.values()}
        self.encodings = {one.message_encoding for one in file.channels.values()}
        self.encodings |= {one.encoding for one in file.schemas.values()}
        by_name = {one.name: one for one in schemas.values()}
        connections = [
            Connection(n, topic, kind, "", "", 1, None, self)
            for n, (topic, kind) in enumerate(self.types.items())
        ]
        self.messages = {topic: [] for topic in self.types}
        decoders = DecoderFactory()
        for known, time, data in file.messages(connections):
            own = by_name[known.msgtype]
            schema = Schema(own.id, own.data.encode(), own.encoding, own.name)
            message = decoders.decoder_for("cdr", schema)(data)
            self.messages[known.topic].append((time, message))
        file.close()


def stamp_of(header):
    return header.stamp.sec * SECOND + header.stamp.nanosec


def poses_of(message):
    """Return the poses of a TFMessage by parent and child."""
    found = {}
    for one in message.transforms:
        place, turn = one.transform.translation, one.transform.rotation
        pose = np.array([place.x, place.y, place.z, turn.x, turn.y, turn.z, turn.w])
        found[one.header.frame_id, one.child_frame_id] = pose
    return found


@pytest.mark.parametrize("base", [True, False])
@pytest.mark.parametrize("begin", [1, 1_700_000_000 * SECOND + 7])
def test_other_libraries_read_what_is_written_and_so_do_we(tmp_path, base, begin):
    path = tmp_path / "a.mcap"
    times = np.arange(1100) * 37 / 1000
    wanted = trajectory(4, 1100, 29, times, velocities=base, base=base)
    assert write_motion_file(path, wanted, G1, None, begin) == ()
    found = read_motion(path, G1)
    assert_same(found, wanted)
    assert ("/tf (map to base_link)" in found.notes[0]) == base
    witness = Witness(path)
    assert witness.types == {
        "/robot_description": "std_msgs/msg/String",
        "/tf_static": "tf2_msgs/msg/TFMessage",
        "/joint_states": "sensor_msgs/msg/JointState",
        "/tf": "tf2_msgs/msg/TFMessage",
    }
    assert witness.encodings == {"cdr", "ros2msg"}
    kept = {topic for topic, qos in witness.qos.items() if b"durability: 1" in qos}
    assert kept == {"/robot_description", "/tf_static"}
    ((_, text),) = witness.messages["/robot_description"]
    assert text.data == G1.urdf
    states = witness.messages["/joint_states"]
    stamps = [begin + round(time * 1e9) for time in times]
    for topic in ("/joint_states", "/tf"):
        assert [time for time, _ in witness.messages[topic]] == stamps
    assert [stamp_of(state.header) for _, state in states] == stamps
    assert {tuple(state.name) for _, state in states} == {wanted.joint_names}
    positions = np.array([state.position for _, state in states])
    np.testing.assert_array_equal(positions, wanted.positions)
    if base:
        rates = np.array([state.velocity for _, state in states])
        np.testing.assert_array_equal(rates, wanted.velocities)
        poses = [poses_of(tf)["map", "base_link"] for _, tf in witness.messages["/tf"]]
        np.testing.assert_array_equal(poses, wanted.base_poses)


def test_transforms_place_all_links(tmp_path):
    path = tmp_path / "a.mcap"
    motion = trajectory(5, 3, 29)
    write_motion(path, motion, G1)
    witness = Witness(path)
    ((_, static),) = witness.messages["/tf_static"]
    positions = motion.arranged([joint.name for joint in G1.movable_joints]).positions
    links = Kinematics(G1).link_poses(motion.base_poses, positions)
    for (_, message), poses in zip(witness.messages["/tf"], links):
        edges = {**poses_of(static), **poses_of(message)}
        above = {child: (parent, pose) for (parent, child), pose in edges.items()}
        for link, wanted in zip(G1.link_names, poses):
            frame, found = link, None
            while frame != "map":
                frame, pose = above[frame]
                found = pose if found is None else compose(pose, found)
            np.testing.assert_allclose(found, wanted, atol=1e-12)


@pytest.mark.parametrize("compression", CompressionType)
def test_what_a_robot_of_ros_2_recorded_is_read(tmp_path, compression):
    path = tmp_path / "rosbag2_0.mcap"
    begin = 1_700_000_000 * SECOND
    stamps = [begin + n * SECOND // 50 for n in range(100)]
    messages = []
    for number, stamp in enumerate(stamps):
        for topic in ("/a/joint_states", "/b/joint_states"):
            one = state(stamp, [KNEE], [number / 7])
            messages.append((topic, stamp + 9, one))
        pose = (number, *PLACE[1:])
        messages.append(("/a/odom", stamp + 9, odometry(stamp, pose)))
        messages.append(("/noise", stamp, ("std_msgs/msg/String", {"data": "x" * 90})))
    path.write_bytes(ros2_bag(messages, compression))
    several = "several robots, /a/joint_states, /b/joint_states"
    with pytest.raises(MotionError, match=several):
        read_motion(path, G1)
    motion = read_motion(path, G1, ReadOptions(topic="a/joint_states"))
    assert motion.positions[:, 0].tolist() == [n / 7 for n in range(100)]
    assert motion.times.tolist() == [(s - begin) / 1e9 for s in stamps]
    assert motion.base_poses[:, 0].tolist() == [*range(100)]
    assert "base from /a/odom" in motion.notes[0]
    path.write_bytes(ros2_bag([*messages[::4], ("/tf", begin, edge(begin, PLACE))]))
    motion = read_motion(path, G1)
    assert motion.base_poses[0].tolist() == [*PLACE]
    with pytest.raises(MotionError, match=r"no joints on /x\. Its topics: /a/joint"):
        read_motion(path, G1, ReadOptions(topic="/x"))


def one_message(kind="sensor_msgs/JointState", data=b"?", encoding="ros1", **options):
    """Make a file of one message, without chunks, as of ROS 1."""
    stream = io.BytesIO()
    writer = Writer(stream, use_chunking=False, **options)
    writer.start("ros1")
    schema = writer.register_schema(kind, "ros1msg", b"?")
    channel = writer.register_channel("/joint_states", encoding, schema)
    writer.add_message(channel, 5, data, 5)
    writer.finish()
    return stream.getvalue()


def test_what_was_converted_from_ros_1_is_read(tmp_path):
    path = tmp_path / "a.mcap"
    store, kind = get_typestore(Stores.ROS1_NOETIC), "sensor_msgs/msg/JointState"
    types, none = store.types, np.empty(0)
    time = types["builtin_interfaces/msg/Time"](sec=3, nanosec=7)
    header = types["std_msgs/msg/Header"](seq=1, stamp=time, frame_id="")
    message = types[kind](header, [KNEE], np.array([0.25]), none, none)
    path.write_bytes(one_message(data=bytes(store.serialize_ros1(message, kind))))
    assert read_motion(path, G1).positions.tolist() == [[0.25]]


STATES = [("/joint_states", n, state(n, [KNEE], [0.5])) for n in range(1, 99)]

BAD = {
    "cut": (lambda: ros2_bag(STATES)[:-300], "ends too early; try 'mcap recover'"),
    "cut chunk": (lambda: ros2_bag(STATES)[:900], "ends too early; try 'mcap recover'"),
    "no summary": (
        lambda: one_message(use_statistics=False),
        "has no summary; try 'mcap recover'",
    ),
    "no channels": (
        lambda: one_message(repeat_channels=False),
        "has no summary; try 'mcap recover'",
    ),
    "empty": (lambda: ros2_bag([]), "has no joint_states.*: nothing"),
    "others": (
        lambda: one_message("foxglove.Log", encoding="json"),
        r"has no joint_states.*with --topic: /joint_states \(foxglove.Log\)",
    ),
    "json": (lambda: one_message(encoding="json"), "has no joint_states"),
    "message": (one_message, "On /joint_states a message is damaged"),
    "codec": (
        lambda: ros2_bag(STATES).replace(b"\4\0\0\0zstd", b"\4\0\0\0lzma"),
        "The bag is compressed with lzma; lz4 and zstd are read",
    ),
    "checksum": (
        lambda: ros2_bag(STATES, CompressionType.NONE).replace(
            b"left_knee_joint", b"left_knee_joinT", 1
        ),
        "The bag cannot be read: crc validation failed in Chunk",
    ),
}


@pytest.mark.parametrize("case", BAD)
def test_what_has_no_motion_is_refused_in_a_sentence(tmp_path, case):
    make, words = BAD[case]
    path = tmp_path / "a.mcap"
    path.write_bytes(make())
    with pytest.raises(MotionError, match=words) as error:
        read_motion(path, G1)
    assert "\n" not in str(error.value)
    assert str(error.value).startswith("a.mcap: ")


def test_times_that_ros_2_cannot_express_are_refused(tmp_path):
    path = tmp_path / "a.mcap"
    write_motion_file(path, trajectory(4, 1, 2), G1, None, 2**31 * SECOND - 1)
    with pytest.raises(MotionError, match="s is too large for a bag"):
        write_motion_file(path, trajectory(4, 1, 2), G1, None, 2**31 * SECOND)
