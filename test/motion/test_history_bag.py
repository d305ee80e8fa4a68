"""The history that a bridge leaves as a bag, and other bags, read as states."""

from dataclasses import fields, replace

import numpy as np
import pytest

pytest.importorskip("rosbag", reason="rosbag is not installed")
pytest.importorskip("tf2_ros", reason="tf2_ros is not installed")

import rosbag
from genpy import Time
from geometry_msgs.msg import Transform, TransformStamped
from sensor_msgs.msg import JointState
from test_motion_writing import G1
from tf2_msgs.msg import TFMessage

from g1_description.bridge.history import keep_last_bag, last_bag
from g1_description.bridge.parameters import RobotParameters
from g1_description.bridge.status import RobotStatus
from g1_description.errors import MotionError
from g1_description.motion.files.history_bag import read_history
from g1_description.motion.history import History
from g1_description.motion.history_chunks import Command, Stretch
from g1_description.robot.state import RobotState

NAMES = tuple(joint.name for joint in G1.movable_joints)
PERIOD = 5_000_000
"""At 200 Hz, in [ns]."""

COMMAND = Command("/me", "joint_commands", "2 joints", NAMES[:2])


def state(number, rng, **fields):
    """Make up a state of the G1 that has everything; ``number`` counts periods."""
    single = (rng.normal(size=size).astype(np.float32) for size in (29, 6, 29))
    velocities, twist, efforts = (one.astype(float) for one in single)
    pose = np.append(rng.normal(size=3), [0.0, 0.0, 0.6, 0.8])
    made = RobotState(
        1_000_000_000 + number * PERIOD,
        NAMES,
        rng.normal(size=29),
        velocities,
        pose,
        twist,
        efforts=efforts,
    )
    return replace(made, **fields)


def left_by(history, tmp_path, monkeypatch):
    """End a bridge that has a history; return its bag."""
    monkeypatch.setenv("ROS_HOME", str(tmp_path))
    robot = RobotParameters("g1", "")
    keep_last_bag(robot, RobotStatus("g1", G1, history))
    return last_bag(robot.namespace)


def assert_same_states(found, wanted):
    """Compare two stretches to the last bit."""
    for field in fields(Stretch):
        one, other = getattr(found, field.name), getattr(wanted, field.name)
        assert (one is None) == (other is None), field.name
        np.testing.assert_array_equal(one, other, field.name)


def test_a_bridge_leaves_all_that_it_knows(tmp_path, monkeypatch):
    rng, history = np.random.default_rng(0), History(600.0)
    for number in range(1500):
        some = dict(zip(NAMES[: 20 if number < 700 else 29], rng.normal(size=29)))
        wanted = {"commanded": some, "commanded_base": rng.normal(size=7)}
        history.add(state(number, rng, **(wanted if number > 300 else {})))
        history.pack()
        history.add_command(COMMAND, rng.normal(size=2))
        if number == 10:
            history.add_command(Command("/you", "play_motion", "stop"))
    path = left_by(history, tmp_path, monkeypatch)
    for seconds, first in ((60.0, 0), (2.0, 1499 - 400)):
        begin = 1_000_000_000 + first * PERIOD
        kept = history.stretch(begin, 1 << 60)
        found, commands = read_history(path, G1, seconds)
        assert_same_states(found, replace(kept, base_twists=None))
        expected = history.commands(begin, 1 << 60, with_positions=True)
        assert len(commands) == len(expected) == (2 if first == 0 else 1)
        for one, other in zip(commands, expected):
            assert one.command == other.command and one.positions.dtype == np.float32
            assert (one.first, one.last, one.count) == (
                other.first,
                other.last,
                other.count,
            )
            np.testing.assert_array_equal(one.stamps, other.stamps)
            np.testing.assert_array_equal(one.positions, other.positions)


def test_what_was_never_commanded_or_known_is_no_topic(tmp_path, monkeypatch):
    rng, history = np.random.default_rng(0), History(600.0)
    for number in range(3):
        history.add(state(number, rng, efforts=None, base_pose=None))
    path = left_by(history, tmp_path, monkeypatch)
    with rosbag.Bag(str(path)) as bag:
        assert {*bag.get_type_and_topic_info()[1]} == {"/joint_states", "/tf_static"}
    found, commands = read_history(path, G1)
    assert found.commanded is found.commanded_bases is None and commands == []
    assert found.efforts is found.base_poses is None


def recorded(path, states):
    """Write a bag as rosbag record does, of stamps in [s], elbows and bases."""
    with rosbag.Bag(str(path), "w") as bag:
        for at, elbow, x in states:
            stamp = Time.from_sec(at)
            message = JointState(name=[NAMES[0]], position=[elbow])
            edge = TransformStamped(child_frame_id="pelvis", transform=Transform())
            edge.transform.translation.x = x
            edge.transform.rotation.w = 1.0
            message.header.stamp = edge.header.stamp = stamp
            edge.header.frame_id = "map"
            bag.write("/g1/joint_states", message, stamp)
            bag.write("/tf", TFMessage([edge]), stamp)
            bag.write("/joint_commands", message, stamp)
    return path


def test_the_last_run_of_a_recorded_bag_is_read(tmp_path):
    before = [(100.0 + 0.01 * n, 0.0, 9.0) for n in range(500)]
    after = [(1.0 + 0.01 * n, 0.01 * n, 0.02 * n) for n in range(300)]
    path = recorded(tmp_path / "a.bag", [*before, *after])
    for seconds, first in ((60.0, 0), (1.0, 199)):
        found, commands = read_history(path, G1, seconds)
        np.testing.assert_allclose(1e-9 * found.stamps, [s[0] for s in after[first:]])
        np.testing.assert_array_equal(
            found.positions[:, 0], [s[1] for s in after[first:]]
        )
        np.testing.assert_array_equal(
            found.base_poses[:, 0], [s[2] for s in after[first:]]
        )
        assert found.names == NAMES[:1] and commands == []
        assert found.efforts is found.velocities is found.commanded is None


def test_what_has_no_joint_states_is_refused_in_a_sentence(tmp_path):
    path = tmp_path / "a.bag"
    with rosbag.Bag(str(path), "w") as bag:
        bag.write("/joint_commands", JointState(), Time(1))
    with pytest.raises(MotionError, match=r"a.bag: .* no joint_states. Its topics: /j"):
        read_history(path, G1)
    path.write_text("time,left_elbow_joint\n0.0,0.0\n")
    with pytest.raises(MotionError, match=r"a.bag: .* is not a rosbag"):
        read_history(path, G1)
    path.write_bytes(recorded(tmp_path / "b.bag", [(1.0, 0.0, 0.0)]).read_bytes()[:-90])
    with pytest.raises(MotionError, match="cannot be read"):
        read_history(path, G1)
