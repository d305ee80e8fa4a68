"""Rosbags: which topics are a motion, and bags that are damaged or hostile."""

import numpy as np
import pytest
from test_motion_writing import G1, assert_same, trajectory

pytest.importorskip("rosbag", reason="rosbag is not installed")

import rosbag
from genpy import Duration, Time
from geometry_msgs.msg import (
    Point,
    Pose,
    Quaternion,
    Transform,
    TransformStamped,
    Vector3,
)
from sensor_msgs.msg import JointState
from std_msgs.msg import Header, String
from tf2_msgs.msg import TFMessage
from trajectory_msgs.msg import (
    JointTrajectory,
    JointTrajectoryPoint,
    MultiDOFJointTrajectory,
    MultiDOFJointTrajectoryPoint,
)

from g1_description.bridge.recorded_file import room_of, write_motion_file
from g1_description.errors import MotionError
from g1_description.motion.files import recordings
from g1_description.motion.files.formats import read_motion
from g1_description.motion.files.source import ReadOptions

ELBOW, KNEE = "left_elbow_joint", "left_knee_joint"
SECOND = 1_000_000_000


def stamp(seconds):
    return Time.from_sec(seconds)


def state(seconds, velocity=(), **positions):
    """Make joint states; names have their _joint added."""
    names = [f"{name}_joint" for name in positions]
    header = Header(stamp=stamp(seconds))
    return JointState(header, names, [*positions.values()], velocity, [])


def edge(seconds, x, parent="map", child="base_link"):
    transform = Transform(Vector3(x, 0.0, 0.0), Quaternion(0.0, 0.0, 0.0, 1.0))
    return TransformStamped(Header(0, stamp(seconds), parent), child, transform)


class Odometry:
    """Serialises as nav_msgs/Odometry does, whose package need not be installed."""

    _type = "nav_msgs/Odometry"
    _md5sum = "cd5e73d190d741a2f92e81eda573aca7"
    _full_text = ""

    def __init__(self, seconds, x):
        self._header = Header(0, stamp(seconds), "odom")
        self._pose = Pose(Point(x, 0.0, 0.0), Quaternion(0.0, 0.0, 0.0, 1.0))

    def serialize(self, stream):
        self._header.serialize(stream)
        String("base_link").serialize(stream)
        self._pose.serialize(stream)
        stream.write(bytes(8 * (36 + 6 + 36)))


class RobotTrajectory:
    """Serialises as moveit_msgs/RobotTrajectory does."""

    _type = "moveit_msgs/RobotTrajectory"
    _md5sum = "dfa9556423d709a3729bcef664bddf67"
    _full_text = ""

    def __init__(self, joints, base):
        self._parts = joints, base

    def serialize(self, stream):
        for part in self._parts:
            part.serialize(stream)


@pytest.fixture
def bag(tmp_path):
    """Give what writes a bag of (topic, message, seconds) and returns its path."""

    def write(*messages, **options):
        path = tmp_path / "a.bag"
        with rosbag.Bag(str(path), "w", **options) as file:
            for topic, message, seconds in messages:
                file.write(topic, message, stamp(seconds))
        return path

    return write


@pytest.mark.parametrize("base", [True, False])
def test_a_bag_is_read_as_it_was_written(tmp_path, base):
    random = np.random.default_rng(3)
    times = np.cumsum(random.integers(1, SECOND, 40)) / 1e9
    times = (np.round(times * 1e9) - np.round(times[0] * 1e9)) / 1e9
    wanted = trajectory(4, 40, 29, times, True, base)
    for begin in (1, 3 * SECOND + 7, 1_700_000_000 * SECOND):
        assert write_motion_file(tmp_path / "a.bag", wanted, G1, None, begin) == ()
        motion = read_motion(tmp_path / "a.bag", G1)
        assert_same(motion, wanted)
        assert "Joints from /joint_states" in motion.notes[0]
        assert ("/tf (map to base_link)" in motion.notes[0]) == base


@pytest.mark.parametrize("ending", [".bag", ".mcap"])
def test_as_many_samples_as_are_promised_are_read_again(tmp_path, monkeypatch, ending):
    path, names = (tmp_path / "a").with_suffix(ending), [KNEE]
    assert room_of(path, names, True) == (122_500, False)
    monkeypatch.setattr(recordings, "MAX_MESSAGES", 1000)
    count = room_of(path, names, True).samples
    wanted = trajectory(4, count, 29, np.arange(count) / 64)
    write_motion_file(path, wanted, G1)
    assert_same(read_motion(path, G1), wanted)
    many = trajectory(4, 1001, 29, np.arange(1001) / 64)
    write_motion_file(path, many, G1)
    with pytest.raises(MotionError, match="more than 1000 messages"):
        read_motion(path, G1)


def test_a_bag_has_the_frames_around_the_robot(tmp_path):
    path = tmp_path / "a.bag"
    write_motion_file(path, trajectory(4, 2, 29), G1)
    with rosbag.Bag(str(path)) as file:
        found = [
            {(e.header.frame_id, e.child_frame_id) for e in message.transforms}
            for _, message, _ in file.read_messages("/tf_static")
        ]
    wanted = {("world", "map"), ("base_link", "pelvis"), ("imu_in_torso", "body_imu")}
    assert found == [wanted]


@pytest.mark.parametrize("compression", ["bz2", "lz4"])
def test_compressed_bags_of_many_chunks_are_read(bag, compression):
    if compression == "lz4":
        pytest.importorskip("roslz4", reason="roslz4 is not there")
    messages = [
        ("/joint_states", state(1 + n / 100, left_knee=n), n + 1) for n in range(300)
    ]
    others = [("/noise", String("x" * 1000), n + 1) for n in range(300)]
    path = bag(*messages, *others, compression=compression, chunk_threshold=5000)
    motion = read_motion(path, G1)
    assert motion.positions[:, 0].tolist() == [*range(300)]
    np.testing.assert_allclose(motion.times, np.arange(300) / 100, atol=1e-9)


def test_the_base_is_interpolated_between_its_stamps(bag):
    states = [("/joint_states", state(1 + n, left_knee=0.0), 50) for n in range(4)]
    base = [
        ("/tf", TFMessage([edge(1 + n, n, "odom"), edge(0, 9, "pelvis", "x")]), 50)
        for n in (0, 2)
    ]
    motion = read_motion(bag(*states, *base), G1)
    assert motion.base_poses[:, 0].tolist() == [0.0, 1.0, 2.0, 2.0]
    assert "/tf (odom to base_link)" in motion.notes[0]


def test_a_base_in_the_map_counts_before_one_in_the_odometry(bag):
    both = [
        ("/joint_states", state(1, left_knee=0.0), 1),
        ("/tf", TFMessage([edge(1, 2.0, "odom"), edge(1, 3.0)]), 1),
        ("/odom", Odometry(1, 4.0), 1),
    ]
    for messages, wanted in ((both, 3.0), (both[::2], 4.0)):
        motion = read_motion(bag(*messages), G1)
        assert motion.base_poses[0, 0] == wanted
    assert "base from /odom" in motion.notes[0]


def test_a_root_beside_base_link_is_placed(bag):
    lifted = edge(1, 0.5, "base_link", "pelvis")
    path = bag(
        ("/joint_states", state(1, left_knee=0.0), 1),
        ("/tf", TFMessage([edge(1, 3.0)]), 1),
        ("/tf_static", TFMessage([lifted]), 1),
    )
    assert read_motion(path, G1).base_poses[0, 0] == 3.5


def test_commands_that_name_some_joints_leave_the_others(bag):
    path = bag(
        ("/joint_commands", state(1, left_knee=1.0), 1),
        ("/joint_commands", state(2, left_elbow=2.0), 2),
        ("/joint_commands", state(3, left_knee=3.0, left_elbow=float("nan")), 3),
    )
    motion = read_motion(path, G1)
    assert motion.joint_names == (KNEE, ELBOW)
    assert motion.positions.tolist() == [[1.0, 2.0], [1.0, 2.0], [3.0, 2.0]]
    assert motion.velocities is None


def point(seconds, positions, velocities=()):
    return JointTrajectoryPoint(
        positions, velocities, [], [], Duration.from_sec(seconds)
    )


def base_point(seconds, x):
    transform = Transform(Vector3(x, 0, 0), Quaternion(0, 0, 0, 1))
    return MultiDOFJointTrajectoryPoint([transform], [], [], Duration.from_sec(seconds))


def test_trajectories_are_read(bag):
    joints = JointTrajectory(
        Header(), [KNEE], [point(0.5, [0.0], [1.0]), point(1.5, [2.0], [3.0])]
    )
    base = MultiDOFJointTrajectory(
        Header(), ["base"], [base_point(0.5, 0.0), base_point(1.5, 4.0)]
    )
    for topic, message, poses in (
        ("/joint_trajectory", joints, None),
        ("/motion", RobotTrajectory(joints, base), [0.0, 4.0]),
        ("/anything", RobotTrajectory(joints, base), [0.0, 4.0]),
        ("/motion", RobotTrajectory(joints, MultiDOFJointTrajectory()), None),
    ):
        motion = read_motion(bag((topic, message, 1), (topic, message, 2)), G1)
        found = motion
        assert found.times.tolist() == [0.5, 1.5]
        assert found.positions.tolist() == [[0.0], [2.0]]
        assert found.velocities.tolist() == [[1.0], [3.0]]
        assert f"Motion from {topic}, the first of 2 messages" in motion.notes[0]
        assert poses is found.base_poses or found.base_poses[:, 0].tolist() == poses


def test_configurations_that_are_streamed_are_samples(bag):
    def message(x):
        joints = JointTrajectory(Header(), [KNEE], [point(0.0, [2.0 * x])])
        base = MultiDOFJointTrajectory(Header(), ["base"], [base_point(0.0, x)])
        return RobotTrajectory(joints, base)

    path = bag(*[("/motion", message(float(n)), 5 + n) for n in range(3)])
    found = read_motion(path, G1)
    assert found.times.tolist() == [0.0, 1.0, 2.0]
    assert found.positions.tolist() == [[0.0], [2.0], [4.0]]
    assert found.base_poses[:, 0].tolist() == [0.0, 1.0, 2.0]
    several = JointTrajectory(Header(), [KNEE], [point(0, [0.0]), point(1, [0.0])])
    path = bag(
        ("/motion", message(0.0), 5),
        ("/motion", RobotTrajectory(several, MultiDOFJointTrajectory()), 6),
    )
    with pytest.raises(
        MotionError, match="Message 2 on /motion must have exactly one point"
    ):
        read_motion(path, G1)


def test_the_topic_is_the_usual_one_or_named(bag):
    states = ("/joint_states", state(1, left_knee=1.0), 1)
    commands = ("/joint_commands", state(1, left_knee=2.0), 1)
    motion = read_motion(bag(states, commands), G1)
    assert motion.positions.tolist() == [[1.0]]
    assert "It also has joints on /joint_commands." in motion.notes[0]
    motion = read_motion(bag(states, commands), G1, ReadOptions(topic="joint_commands"))
    assert motion.positions.tolist() == [[2.0]]
    left = ("/left/joint_states", state(1, left_knee=3.0), 1)
    base = ("/tf", TFMessage([edge(1, 1.0), edge(1, 2.0, child="left/base_link")]), 1)
    motion = read_motion(bag(left, base), G1)
    assert motion.base_poses[0, 0] == 2.0
    right = ("/right/joint_states", state(1, left_knee=4.0), 1)
    for messages, topic, words in (
        ((left, right), None, "several robots, /left/joint_states, /right/joint_st"),
        ((states,), "/none", "no joints on /none. Its topics: /joint_states"),
        ((("/noise", String("x"), 1),), None, "--topic: /noise (std_msgs/String)"),
        ((), None, "--topic: nothing"),
        (
            (("/a", state(1, left_knee=4.0), 1), ("/b", state(1, left_knee=4.0), 1)),
            None,
            "Choose the topic of the joints with --topic: /a, /b",
        ),
    ):
        with pytest.raises(MotionError) as error:
            read_motion(bag(*messages), G1, ReadOptions(topic=topic))
        assert words in str(error.value)


def test_stamps_that_are_missing_equal_or_go_back_are_dealt_with(bag):
    def read(*seconds):
        messages = [
            ("/joint_states", state(s, left_knee=n), 10 + n)
            for n, s in enumerate(seconds)
        ]
        motion = read_motion(bag(*messages), G1)
        found = motion
        return found.times.tolist(), found.positions[:, 0].tolist(), motion.notes

    assert read(0, 0, 0)[:2] == ([0.0, 1.0, 2.0], [0.0, 1.0, 2.0])
    assert "times of recording are used" in read(0, 0)[2][1]
    assert read(1, 2, 2, 3)[:2] == ([0.0, 1.0, 2.0], [0.0, 2.0, 3.0])
    times, positions, notes = read(1, 3, 2, 5)
    assert (times, positions) == ([0.0, 1.0, 2.0, 4.0], [0.0, 2.0, 1.0, 3.0])
    assert notes[1] == "Late samples are sorted by stamps: 1 of 4."
    for stray in (90, 5):
        times, positions, notes = read(10, 11, stray, 12, 13)
        assert (times, positions) == ([0.0, 1.0, 2.0, 3.0], [0.0, 1.0, 3.0, 4.0])
        assert "ignored: 1 of 5 samples" in notes[1]
    times, positions, notes = read(11, 12, 13, 1, 2)
    assert (times, positions) == ([0.0, 1.0, 2.0], [0.0, 1.0, 2.0])
    assert notes[1] == (
        "Time goes back after 2.000 s; the last 2 of 5 samples (1.000 s) are ignored."
    )
    usual = [1 + 0.02 * n for n in range(60)]
    for stamps, count, words in (
        ([*usual[:30], 9, 9.1, *usual[30:]], 60, "ignored: 2 of 62 samples"),
        ([*usual[:20], *usual], 20, "the last 60 of 80 samples"),
        ([9, *usual, 9], 60, "ignored: 2 of 62 samples"),
        ([*usual[:-1], usual[-2] - 0.001], 60, "sorted by stamps: 1 of 60"),
    ):
        times, _, notes = read(*stamps)
        assert len(times) == count
        assert words in notes[1]


def test_samples_of_two_publishers_are_joined_by_their_clocks(bag):
    """Of the same joints in two orders, 0.1 s apart; the base is late, too."""
    messages = []
    for n in range(40):
        now = 5 + 0.02 * n
        one = state(now, left_knee=now, right_knee=0.0)
        other = state(now - 0.1, right_knee=0.0, left_knee=now - 0.1)
        messages += [("/joint_states", one, now), ("/joint_states", other, now + 0.01)]
        for late in (0.0, 0.05):
            messages.append(("/tf", TFMessage([edge(now - late, now - late)]), now))
    found = read_motion(bag(*messages), G1)
    column = found.joint_names.index("left_knee_joint")
    assert found.duration == pytest.approx(0.88)
    np.testing.assert_allclose(found.positions[:, column], found.times + 4.9)
    inside = found.times >= 0.05
    np.testing.assert_allclose(
        found.base_poses[inside, 0], found.times[inside] + 4.9, atol=1e-6
    )
    assert "Samples of 2 publishers are joined by their stamps" in " ".join(found.notes)
    assert "Late samples are sorted by stamps: 40 of 80, as of" in found.notes[1]


def test_a_base_that_ends_early_is_told(bag):
    messages = [("/joint_states", state(5 + n, left_knee=n), 5 + n) for n in range(9)]
    stamps = [5, 6, 7, 1, 2]
    frames = [("/tf", TFMessage([edge(s, s)]), 5 + n) for n, s in enumerate(stamps)]
    found = read_motion(bag(*messages, *frames), G1)
    assert found.base_poses[:, 0].tolist() == [5.0, 6.0, *[7.0] * 7]
    assert "the last 2 of 5 base poses" in found.notes[1]


def test_the_run_before_a_reset_is_read_where_recorded_times_go_back(bag):
    # rosbag record writes simulated time, so both runs have the same times.
    runs = [
        ("/joint_states", state(1 + 0.01 * n, left_knee=knee), 1 + 0.01 * n)
        for knee, count in ((0.1, 30), (0.9, 20))
        for n in range(count)
    ]
    motion = read_motion(bag(*runs, **{"chunk_threshold": 500}), G1)
    assert motion.positions[:, 0].tolist() == [0.1] * 30
    assert "Time goes back after 0.290 s" in motion.notes[1]


def test_a_rate_for_a_bag_is_told_to_be_ignored(bag):
    path = bag(("/joint_states", state(1, left_knee=1.0), 1))
    notes = read_motion(path, G1, ReadOptions(30.0)).notes
    assert any("its own times" in note for note in notes)


def test_wrong_messages_are_told(bag):
    sizes = JointState(Header(stamp=stamp(1)), [KNEE, ELBOW], [1.0], [], [])
    ragged = JointTrajectory(Header(), [KNEE], [point(0, [0.0, 1.0])])
    empty = JointTrajectory(Header(), [KNEE], [])
    infinite = state(1, left_knee=float("inf"))
    for topic, message, words in (
        ("/joint_states", sizes, "Message 1 on /joint_states has 1 positions of 2"),
        ("/joint_states", infinite, "The position of sample 1"),
        ("/joint_states", state(1, a=1.0), "none of the motion's joints, a_joint"),
        (
            "/joint_trajectory",
            ragged,
            "Point 1 on /joint_trajectory must have 1 numbers",
        ),
        ("/joint_trajectory", empty, "no points of joints"),
    ):
        with pytest.raises(MotionError, match=words):
            read_motion(bag((topic, message, 1)), G1)


def test_a_bag_without_an_index_is_told_what_to_do(bag, tmp_path):
    path = bag(*[("/joint_states", state(n + 1, left_knee=1.0), 1) for n in range(9)])
    content = bytearray(path.read_bytes())
    place = content.index(b"index_pos=") + len(b"index_pos=")
    content[place : place + 8] = bytes(8)
    path.write_bytes(content)
    with pytest.raises(MotionError, match="Bag is not indexed, reindex before"):
        read_motion(path, G1)
    content[:13] = b"#ROSBAG V1.2\n"
    path.write_bytes(content)
    with pytest.raises(MotionError, match="Bag version 102 is not supported"):
        read_motion(path, G1)


def test_what_is_no_bag_has_no_topic(tmp_path):
    path = tmp_path / "a.csv"
    path.write_text(f"time,{KNEE}\n0,1\n")
    with pytest.raises(MotionError, match="the topic joint_states needs one"):
        read_motion(path, G1, ReadOptions(topic="joint_states"))


def test_a_damaged_bag_is_read_or_refused_and_nothing_else(bag):
    path = bag(
        *[("/joint_states", state(n + 1, left_knee=1.0), n + 1) for n in range(20)],
        ("/tf", TFMessage([edge(1, 1.0)]), 30),
    )
    whole, random, refused = path.read_bytes(), np.random.default_rng(5), 0
    for number in range(60):
        data = bytearray(whole)
        if number % 3 == 0:
            data = data[: random.integers(13, len(whole))]
        for _ in range(random.integers(0, 4)):
            data[13 + random.integers(len(data) - 13)] = random.integers(256)
        path.write_bytes(data)
        try:
            read_motion(path, G1)
        except MotionError as error:
            refused += 1
            assert "\n" not in str(error)
    assert refused > 20


def test_definitions_in_a_bag_are_not_run(bag, tmp_path):
    """ROS' own reader would compile this one."""
    path = bag(("/joint_states", state(1, left_knee=1.0), 1))
    content = path.read_bytes()
    definition = JointState._full_text.encode()
    path.write_bytes(content.replace(definition, b"?" * len(definition)))
    assert read_motion(path, G1).positions.tolist() == [[1.0]]
