"""The command record: what it saves is what was published, and plays again."""

import os
import signal
import subprocess
import tempfile
import unittest
from pathlib import Path

import numpy as np
import rospy
from g1_description.msg import RobotTrajectory
from g1_description.srv import PlayMotion
from gazebo_msgs.msg import WorldState
from gazebo_msgs.srv import DeleteModel, SpawnModel
from geometry_msgs.msg import Point, Pose, Quaternion
from sensor_msgs.msg import JointState
from std_srvs.srv import Empty
from support.ros_testing import (
    DEADLINE,
    REPOSITORY,
    Connected,
    Listener,
    is_at,
    position_of,
    program,
    step_by,
    wait_for,
)
from tf2_msgs.msg import TFMessage
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

ELBOW = "left_elbow_joint"
HEADER = "time,base_x,base_y,base_z,base_qx,base_qy,base_qz,base_qw"
COMMON = """
import sys, numpy as np
from pathlib import Path
from g1_description.motion.trajectory import sample
from g1_description.robot.urdf import parse_urdf
from g1_description.motion.files.formats import read_motion
robot = parse_urdf(Path(sys.argv[1]).read_text())
def read(path):
    return read_motion(Path(path), robot).trajectory
"""
READ = """
found = read(sys.argv[2])
np.savez(sys.argv[3], times=found.times, names=np.array(found.joint_names),
    positions=found.positions, base=found.base_poses)
"""
COMPARE = """
def rise(motion):
    # The longest part in which the base goes forward.
    ends = np.flatnonzero(np.diff(motion.base_poses[:, 0]) <= 0.0)
    ends = np.concatenate([[-1], ends, [len(motion.times) - 1]])
    longest = np.argmax(np.diff(ends))
    return slice(ends[longest] + 1, ends[longest + 1] + 1)
first, second = read(sys.argv[2]), read(sys.argv[3])
one, other = rise(first), rise(second)
times, x = second.times[other], second.base_poses[other]
middle = len(times) // 2
found = np.interp(x[middle, 0], first.base_poses[one, 0], first.times[one])
times = times - times[middle] + found
inside = (times >= first.times[one][0]) & (times <= first.times[one][-1])
wanted = sample(first, times[inside])
joints = np.abs(second.positions[other][inside] - wanted.positions).max()
print(inside.sum(), joints, np.abs(x[inside] - wanted.base_poses).max())
"""

FULL = """
from g1_description.cli import record
from g1_description.cli.recorded_file import Room, room_of
def room(path, joints, has_base):
    # As if the file could hold this many samples; without a number, had no base.
    most = int(limit)
    return Room(most, path.suffix == ".npz") if most else room_of(path, joints, False)
limit, record.room_of = sys.argv[2], room
sys.argv[1:] = sys.argv[3:]
record.main()
"""


def start(name, *arguments):
    return subprocess.Popen(
        [program(name), *map(str, arguments)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )


class TestRecord(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        step_by(0.005)
        cls.states = Connected("/joint_states", JointState, queue_size=None)
        cls.tf = Connected("/tf", TFMessage, queue_size=None)
        cls.states.wait()

    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.folder = Path(folder.name)
        self.wave = self.folder / "wave.csv"
        times = 0.05 * np.arange(31)
        turns = np.sin(2.0 * times)
        rows = [
            f"{t!r},{0.5 * e!r},0.0,0.9,0.0,0.0,0.0,1.0,{e!r}"
            for t, e in zip(times.tolist(), turns.tolist())
        ]
        self.wave.write_text("\n".join([f"{HEADER},{ELBOW}", *rows]))

    @staticmethod
    def python(script, *arguments, **options):
        """Run a script with the Python of the nodes; return what it prints."""
        python = Path(program("record")).read_text().splitlines()[0][2:].split()
        model = REPOSITORY / "urdf" / "g1_29dof.urdf"
        return subprocess.run(
            [*python, "-c", COMMON + script, model, *map(str, arguments)],
            **{"stdout": subprocess.PIPE, "text": True, "check": True, **options},
        ).stdout

    def read(self, path):
        """Read a motion: all of it, the elbow, and the base along x."""
        out = self.folder / "read.npz"
        self.python(READ, path, out)
        found = dict(np.load(str(out)))
        elbow = found["names"].tolist().index(ELBOW)
        return found, found["positions"][:, elbow], found["base"][:, 0]

    def play(self, file):
        """Play a motion again and again until the test ends; return what ends it."""
        player = start("play", file, "--loop")

        def end():
            if player.poll() is None:
                os.killpg(player.pid, signal.SIGINT)
                player.communicate(timeout=DEADLINE)

        self.addCleanup(end)
        self.states.clear()
        rest = position_of(self.states.wait(), ELBOW)  # where the last one was left
        self.states.wait(lambda m: rest != position_of(m, ELBOW) > 0.1, "the wave")
        return end

    def record(self, name, *arguments):
        run = start("record", self.folder / name, *arguments)
        out, err = run.communicate(timeout=DEADLINE)
        self.assertEqual(run.returncode, 0, err)
        self.assertNotIn("Traceback", err)
        self.assertIn("samples", out)
        return err

    def test_a_bag_has_what_was_published_under_each_stamp(self):
        self.play(self.wave)
        self.record("a.bag", "--seconds", "2", "--rate", "0")
        import rosbag

        published = {m.header.stamp: m for m in list(self.states.messages)}
        bases = {
            edge.header.stamp: edge.transform.translation.x
            for message in list(self.tf.messages)
            for edge in message.transforms
            if edge.child_frame_id == "base_link"
        }
        states = edges = 0
        with rosbag.Bag(str(self.folder / "a.bag")) as bag:
            for topic, message, stamp in bag.read_messages():
                if topic == "/joint_states":
                    self.assertEqual(message.header.stamp, stamp)
                    self.assertEqual(message.name, published[stamp].name)
                    self.assertEqual(message.position, published[stamp].position)
                    self.assertEqual(message.velocity, published[stamp].velocity)
                    states += 1
                elif topic == "/tf" and stamp in bases:
                    (edge,) = message.transforms
                    x = edge.transform.translation.x
                    self.assertAlmostEqual(x, bases[stamp], delta=1e-12)
                    edges += 1
        self.assertEqual(states, 201)
        self.assertGreater(edges, 30)

    def test_a_recording_ends_with_its_simulator(self):
        states = rospy.Publisher("/other/world_state", WorldState, queue_size=1)
        real = Listener("/gazebo/world_state", WorldState)
        world = real.wait()
        real.close()
        run = start("record", self.folder / "a.csv", "--gazebo", "/other")
        wait_for(states.get_num_connections, "the recorder")
        states.publish(world)
        self.assertIn("recording until Ctrl-C", run.stderr.readline())
        states.unregister()
        _, err = run.communicate(timeout=DEADLINE)
        self.assertEqual(run.returncode, 0, err)
        self.assertIn("the recording ends after 0.000 s: the simulator ended", err)
        found, _, _ = self.read(self.folder / "a.csv")
        self.assertEqual(len(found["times"]), 1)

    def test_what_was_recorded_plays_again_as_the_same(self):
        # Each takes longer than a round and its rise: a whole rise is in it.
        stop = self.play(self.wave)
        self.record("first.csv", "--seconds", "3.5", "--rate", "0")
        stop()
        self.play(self.folder / "first.csv")
        self.record("second.csv", "--seconds", "5.5", "--rate", "0")
        files = self.folder / "first.csv", self.folder / "second.csv"
        count, joints, base = map(float, self.python(COMPARE, *files).split())
        self.assertGreater(count, 50)
        self.assertLess(joints, 1e-9)
        self.assertLess(base, 1e-9)

    def test_base_and_joints_are_of_one_instant_in_each_format(self):
        self.play(self.wave)
        for name in ("a.csv", "a.npz", "a.bag"):
            err = self.record(name, "--seconds", "2", "--rate", "50")
            self.assertNotIn("not even", err)
            found, elbow, x = self.read(self.folder / name)
            np.testing.assert_array_equal(found["times"], np.arange(101) / 50.0)
            np.testing.assert_allclose(x, 0.5 * elbow, atol=1e-12)
            self.assertGreater(np.ptp(elbow), 0.5)
        self.record("b.npz", "--seconds", "1", "--rate", "60")
        found, elbow, x = self.read(self.folder / "b.npz")
        np.testing.assert_array_equal(found["times"], np.arange(61) / 60.0)

    def test_an_interrupt_ends_and_saves(self):
        for kind in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
            file = self.folder / "a.csv"
            run = start("record", file, "--force")
            self.assertIn("recording until Ctrl-C", run.stderr.readline())
            stamp = rospy.Time.now()
            wait_for(
                lambda begin=stamp: (rospy.Time.now() - begin).to_sec() > 1.0, "time"
            )
            os.killpg(run.pid, kind)
            out, err = run.communicate(timeout=DEADLINE)
            self.assertEqual((run.returncode, err), (0, ""))
            self.assertIn("samples", out)
            found, _, _ = self.read(file)
            # How many depends on when the recorder heard of the first state.
            self.assertGreater(len(found["times"]), 1)
            self.assertEqual(
                {*os.listdir(self.folder)}, {"wave.csv", "a.csv", "read.npz"}
            )

    def test_a_reset_ends_and_saves(self):
        rospy.wait_for_service("/gazebo/reset_simulation", DEADLINE)
        run = start("record", self.folder / "a.bag")
        self.assertIn("recording until Ctrl-C", run.stderr.readline())
        stamp = rospy.Time.now()
        wait_for(lambda: (rospy.Time.now() - stamp).to_sec() > 0.5, "time")
        rospy.ServiceProxy("/gazebo/reset_simulation", Empty)()
        _, err = run.communicate(timeout=DEADLINE)
        self.assertEqual(run.returncode, 0, err)
        self.assertRegex(err, "the recording ends after .* s: time went back")
        found, _, _ = self.read(self.folder / "a.bag")
        # How many depends on when the recorder heard of the first state.
        self.assertGreater(len(found["times"]), 1)

    def test_a_full_file_ends_and_is_saved(self):
        for name, rate in (("a.csv", 0), ("b.csv", 50), ("a.npz", 50), ("a.bag", 50)):
            with self.subTest(name):
                file, errors = self.folder / name, self.folder / "errors"
                with errors.open("w") as stream:
                    arguments = 40, file, "--rate", rate
                    self.python(FULL, *arguments, stderr=stream, timeout=DEADLINE)
                self.assertIn("s: the file is full", errors.read_text())
                found, _, _ = self.read(file)
                self.assertIn(len(found["times"]), (39, 40))

    def test_a_robot_without_a_base_is_not_recorded_to_an_npz(self):
        errors = self.folder / "errors"
        with errors.open("w") as stream:
            arguments = 0, self.folder / "a.npz"
            options = {"stderr": stream, "timeout": DEADLINE, "check": False}
            self.python(FULL, *arguments, **options)
        self.assertEqual(
            errors.read_text(),
            "record: An npz needs base poses, and this motion has none; write .csv.\n",
        )

    def test_of_several_robots_one_must_be_named(self):
        spawn = rospy.ServiceProxy("/gazebo/spawn_urdf_model", SpawnModel)
        delete = rospy.ServiceProxy("/gazebo/delete_model", DeleteModel)
        urdf = rospy.get_param("/robot_description")
        place = Pose(Point(0.0, 3.0, 1.0), Quaternion(0.0, 0.0, 0.0, 1.0))
        self.assertTrue(spawn("other", urdf, "", place, "world").success)
        self.addCleanup(delete, "other")
        # Another name of the simulator, so that it need not be the bridge's.
        run = start("record", self.folder / "a.csv", "--gazebo", "gazebo")
        _, err = run.communicate(timeout=DEADLINE)
        self.assertEqual(run.returncode, 1)
        self.assertIn("several match", err)
        self.assertIn("choose one with --model", err)
        self.states.clear()
        play = rospy.ServiceProxy("/play_motion", PlayMotion)
        bent = JointTrajectoryPoint(positions=[0.7])
        motion = RobotTrajectory()
        motion.joint_trajectory = JointTrajectory(joint_names=[ELBOW], points=[bent])
        self.assertTrue(play(motion).success)
        self.states.wait(lambda m: is_at(m, ELBOW, 0.7), "the elbow")
        self.record("a.csv", "--model", "other", "--seconds", "0.2", "--force")
        _, elbow, _ = self.read(self.folder / "a.csv")
        self.assertFalse(elbow.any(), "joints of the robot in the default namespace")

    def assert_refused(self, run, words):
        _, err = run.communicate(timeout=DEADLINE)
        self.assertEqual(run.returncode, 1)
        self.assertIn(words, err)
        self.assertNotIn("Traceback", err)

    def test_what_cannot_be_recorded_is_told(self):
        (self.folder / "there.csv").write_text("")
        wrong = (
            ("already exists; use --force to replace it", "there.csv"),
            ("must end in .csv or .npz or .bag", "a.txt"),
            ("cannot be written: No such file", "no/a.csv"),
            ("--rate: must be a number from 0", "a.csv", "--rate", "-1"),
            ("There was no state of the robot", "a.csv", "--gazebo", "/nowhere"),
        )
        missing = (
            ("The simulator has no model 'nobody' with", "--model", "nobody"),
            ("Nothing publishes /left/robot_state; is the", "--namespace", "left"),
        )
        runs = [
            start("record", self.folder / f"{n}.csv", *rest)
            for n, (_, *rest) in enumerate(missing)
        ]
        for (words, *_), run in zip(missing, runs):
            self.assert_refused(run, words)
        # Waits for states cost less where none come.
        rospy.ServiceProxy("/gazebo/pause_physics", Empty)()
        self.addCleanup(rospy.ServiceProxy("/gazebo/unpause_physics", Empty))
        runs = [start("record", self.folder / name, *rest) for _, name, *rest in wrong]
        for (words, *_), run in zip(wrong, runs):
            with self.subTest(words):
                self.assert_refused(run, words)
        self.assertEqual({*os.listdir(self.folder)}, {"there.csv", "wave.csv"})
