"""The command record: what it saves is what was published.

Everything records at the same time, each recording ends in its own way. Which states
are taken, and what is refused, is tested in test/cli/test_recorder.py.
"""

import os
import signal
from types import SimpleNamespace

import numpy as np
import pytest
import rosbag
import rospy
from g1_description.msg import RobotState, SimulatorState
from g1_description.srv import AttachObject, DetachObject, PlayMotion
from gazebo_msgs.srv import DeleteModel, GetModelState, SpawnModel
from geometry_msgs.msg import Point, Pose, Quaternion
from sensor_msgs.msg import JointState
from std_srvs.srv import Empty
from support.programs import Program
from support.ros_testing import (
    Connected,
    Listener,
    position_of,
    service,
    step_by,
    wait_for,
)

from g1_description.bridge.recorded_file import Room
from g1_description.cli.recorder import Recorder, SimulatorStates
from g1_description.motion.files.formats import read_motion
from g1_description.motion.motion import Motion
from g1_description.robot.urdf import parse_urdf
from g1_description.ros.conversions import pose_from_array, pose_to_array
from g1_description.ros.playing import MotionClient
from g1_description.scenes.carried import holds_of, motion_links, object_poses
from g1_description.scenes.scene import Scene
from g1_description.scenes.scene_file import sdf_model

ELBOW = "left_elbow_joint"
PERIOD = 0.02
WAYS = {
    "interrupted.csv": "--rate 0",
    "reset.bag": "--rate 0",
    "seconds.npz": "--rate 25 --seconds 1",
    # Another name of the simulator, so that it need not be the bridge's.
    "other.csv": "--gazebo gazebo --model other",
    "gone.csv": "--gazebo /gone",
    "left.csv": "--namespace left",
}
"""Names of files, and options of the recordings."""


class Recordings:
    """All recordings, and what was published meanwhile."""

    def __init__(self, folder):
        self.folder = folder
        self.joints = Connected("/joint_states", JointState, queue_size=None)
        self.states = Connected("/robot_state", RobotState, queue_size=None)
        self.states.wait(lambda m: position_of(m, ELBOW) > 0.1, "the wave")
        self.runs = {name: self._start(name, *WAYS[name].split()) for name in WAYS}
        self.errors = {}

    def _start(self, name, *options):
        return Program("record", self.folder / name, *options)

    def wait_for_begin(self, *names):
        for name in names:
            assert "until Ctrl-C" in self.runs[name].stderr.readline()

    def end(self, name, number=0):
        """Wait for the end of a recording, after a signal."""
        if number:
            os.killpg(self.runs[name].pid, number)
        out, self.errors[name] = self.runs[name].communicate()
        assert self.runs[name].returncode == 0, self.errors[name]
        assert f"{self.folder / name}: " in out

    def now(self):
        return position_of(self.states.messages[-1], ELBOW)

    def read(self, name):
        """Read a motion, as play does: the times, the elbow, the base along x."""
        robot = parse_urdf(rospy.get_param("/robot_description"))
        motion = read_motion(self.folder / name, robot)
        elbow = motion.positions[:, motion.joint_names.index(ELBOW)]
        return SimpleNamespace(
            times=motion.times, elbow=elbow, x=motion.base_poses[:, 0]
        )


def until_reset(listener):
    """Wait until a reset is heard; give the messages before it."""

    def before():
        found = [message.header.stamp for message in listener.messages]
        return next(
            (n for n, (a, b) in enumerate(zip(found, found[1:]), 1) if b < a), 0
        )

    return listener.messages[: wait_for(before, "the reset")]


def wave():
    """Make a motion of a minute, in which the elbow is where twice the base is."""
    times = 0.05 * np.arange(1200)
    elbow = np.sin(2.0 * times) + 0.01 * times  # each position once
    base = np.tile([0.0, 0.0, 0.9, 0.0, 0.0, 0.0, 1.0], (len(times), 1))
    base[:, 0] = 0.5 * elbow
    return Motion(times, (ELBOW,), elbow[:, np.newaxis], None, base)


def refusal_of(model):
    """Measure a model without a bridge, in this node; give why that cannot be."""
    robot = parse_urdf(rospy.get_param("/robot_description"))
    recorder = Recorder(0, None, lambda names, has_base: Room(9, False))
    states = SimulatorStates(robot, "/gazebo", model, "", recorder)

    def refusal():
        states.keep_up()
        return recorder.refusal or states.problem

    found = wait_for(refusal, "a refusal")
    assert not recorder.states
    return str(found)


@pytest.fixture(scope="module")
def recordings(tmp_path_factory):
    step_by(PERIOD)
    gone = rospy.Publisher("/gone/simulator_state", SimulatorState, queue_size=1)
    world = Listener("/gazebo/simulator_state", SimulatorState)
    state = world.wait()
    world.close()
    joints = Listener("/joint_states", JointState)
    joints.wait()
    joints.close()
    spawn = service("/gazebo/spawn_urdf_model", SpawnModel)
    place = Pose(Point(0.0, 3.0, 1.0), Quaternion(0.0, 0.0, 0.0, 1.0))
    urdf = rospy.get_param("/robot_description")
    assert spawn("other", urdf, "", place, "world").success
    box = Scene().box("box", [0.1, 0.1, 0.1], [0.3, 0.2, 1.0])
    spawn_sdf = service("/gazebo/spawn_sdf_model", SpawnModel)
    spawn_sdf(
        "box",
        sdf_model("box", {"link": box}, box.pose),
        "",
        pose_from_array(box.pose),
        "",
    )
    MotionClient(service("/play_motion", PlayMotion)).play(wave())
    made = Recordings(tmp_path_factory.mktemp("recordings"))
    wait_for(gone.get_num_connections, "a recorder")
    gone.publish(state)
    made.wait_for_begin("gone.csv")
    gone.unregister()
    made.wait_for_begin("interrupted.csv", "reset.bag", "other.csv", "seconds.npz")
    attach = service("/gazebo/attach_object", AttachObject)
    assert attach("box", "g1_robot", "left_hand").success
    begin, start = rospy.get_time(), made.now()
    # At the end of a swing, where it is slow: a busy machine lets go late.
    wait_for(
        lambda: abs(made.now()) > 0.95 and abs(made.now() - start) > 0.5,
        "the other end of the swing",
    )
    assert service("/gazebo/detach_object", DetachObject)("box").success
    end = rospy.get_time()
    made.held = end - begin
    made.box = service("/gazebo/get_model_state", GetModelState)("box", "").pose
    made.joints.wait(lambda m: m.header.stamp.to_sec() > end + 0.2, "the rest")
    made.end("interrupted.csv", signal.SIGINT)
    made.end("other.csv", signal.SIGHUP)
    made.end("seconds.npz")
    made.refusals = [refusal_of("nobody"), refusal_of("")]
    service("/gazebo/reset_simulation", Empty)()
    made.end("reset.bag")
    made.published = {m.header.stamp: m for m in until_reset(made.joints)}
    states = until_reset(made.states)
    made.elbow = np.array([position_of(message, ELBOW) for message in states])
    made.x = np.array([message.base_pose.position.x for message in states])
    for name in ("other", "box"):
        service("/gazebo/delete_model", DeleteModel)(name)
    made.end("gone.csv")
    yield made
    made.joints.close()
    made.states.close()


def test_a_csv_until_ctrl_c_has_every_state(recordings):
    found = recordings.read("interrupted.csv")
    assert "interrupted" not in recordings.errors["interrupted.csv"]
    assert len(found.times) > 10
    np.testing.assert_allclose(found.times, PERIOD * np.arange(len(found.times)))
    # Base and joints of one instant, as they were published.
    np.testing.assert_allclose(found.x, 0.5 * found.elbow, atol=1e-12)
    (first,) = np.flatnonzero(recordings.elbow == found.elbow[0])
    part = slice(first, first + len(found.times))
    np.testing.assert_array_equal(found.elbow, recordings.elbow[part])
    np.testing.assert_array_equal(found.x, recordings.x[part])


def test_the_scene_next_to_it_has_what_was_carried_and_when(recordings):
    scene = Scene.read(recordings.folder / "interrupted.scene.yaml")
    (held,) = scene["box"].attachments
    assert held.link == "left_hand"
    assert abs(held.end - held.begin - recordings.held) < 0.2
    robot = parse_urdf(rospy.get_param("/robot_description"))
    motion = read_motion(recordings.folder / "interrupted.csv", robot)
    links = motion_links(robot, motion)
    holds = holds_of(scene.values(), robot, links)
    ((found,),) = object_poses(holds, motion.times[-1:], links)
    expected = pose_to_array(recordings.box)
    assert np.abs(expected - scene["box"].pose).max() > 0.05
    np.testing.assert_allclose(found, expected, atol=0.05)  # of a busy machine
    # Another robot carried it.
    other = Scene.read(recordings.folder / "other.scene.yaml")
    assert not other["box"].attachments


def test_an_npz_of_one_second_is_even_at_its_rate(recordings):
    found = recordings.read("seconds.npz")
    assert "evenly" not in recordings.errors["seconds.npz"]
    np.testing.assert_array_equal(found.times, np.arange(26) / 25.0)
    np.testing.assert_allclose(found.x, 0.5 * found.elbow, atol=1e-12)
    assert {*found.elbow} <= {*recordings.elbow}


def test_a_bag_until_a_reset_has_what_was_published_under_each_stamp(recordings):
    assert "s: time went back." in recordings.errors["reset.bag"]
    states, base = {}, {}
    with rosbag.Bag(str(recordings.folder / "reset.bag")) as bag:
        for topic, message, stamp in bag.read_messages(["/joint_states", "/tf"]):
            header = message if topic == "/joint_states" else message.transforms[0]
            assert header.header.stamp == stamp
            (states if topic == "/joint_states" else base)[stamp] = message
    assert len(states) > 10 and states.keys() == base.keys()
    for stamp, message in states.items():
        published = recordings.published[stamp]
        (edge,) = base[stamp].transforms
        assert (edge.header.frame_id, edge.child_frame_id) == ("map", "base_link")
        assert message.name == published.name
        assert message.position == published.position
        assert message.velocity == published.velocity
        elbow = position_of(message, ELBOW)
        assert abs(edge.transform.translation.x - 0.5 * elbow) < 1e-12


def test_another_robot_is_recorded_until_its_terminal_is_closed(recordings):
    found = recordings.read("other.csv")
    assert len(found.times) > 1
    assert not found.elbow.any(), "joints of the robot in the default namespace"


def test_a_recording_ends_with_its_simulator(recordings):
    errors = recordings.errors["gone.csv"]
    assert "the recording ends after 0.000 s: the simulator ended." in errors
    assert errors.count("; is time paused?") == 1
    assert len(recordings.read("gone.csv").times) == 1


def test_a_model_that_is_not_there_or_one_of_two_is_told(recordings):
    nobody, several = recordings.refusals
    assert "has no model 'nobody' with the links of 'g1_29dof'" in nobody
    assert "several match, g1_robot, other: choose one with --model" in several


def test_a_robot_that_nobody_publishes_is_told(recordings):
    run = recordings.runs["left.csv"]
    _, errors = run.communicate()
    assert run.returncode == 1
    assert errors.endswith(
        "Nothing publishes /left/robot_state; is the namespace right?\n"
    )
    assert "Traceback" not in errors
    found = {n for n in os.listdir(recordings.folder) if not n.endswith(".scene.yaml")}
    assert found == {*WAYS} - {"left.csv"}
