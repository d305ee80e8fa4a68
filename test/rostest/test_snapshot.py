"""The real command against the display: pictures and films of what the robot does."""

import io
import os
import re
import signal
import subprocess
import tempfile
import threading
import time
import unittest
from contextlib import closing
from pathlib import Path

import numpy as np
import rosgraph
import rospy
from gazebo_msgs.msg import ModelState
from gazebo_msgs.srv import SetModelState
from geometry_msgs.msg import Point, Pose, Quaternion
from sensor_msgs.msg import JointState
from std_srvs.srv import Empty
from support.ros_testing import DEADLINE, Connected, Repeated, program, wait_for

READ = """
import io, sys, numpy as np
from PIL import Image, ImageSequence
images = [
    (np.array(image.convert("RGB")), image.info.get("duration", 0))
    for image in ImageSequence.Iterator(Image.open(sys.argv[1]))
]
content = io.BytesIO()
np.savez(content, frames=[i[0] for i in images], lengths=[i[1] for i in images])
sys.stdout.buffer.write(content.getvalue())
"""


def read_frames(path):
    """Read a picture or a film with the Python of the nodes; ours has no Pillow.

    Returns:
        Colours, shape (n, height, width, 3), and how long each is shown in [ms].
    """
    python = Path(program("snapshot")).read_text().splitlines()[0][2:].split()
    run = subprocess.run(
        [*python, "-c", READ, path], stdout=subprocess.PIPE, check=True
    )
    content = np.load(io.BytesIO(run.stdout))
    return content["frames"], content["lengths"]


def start(*arguments):
    environment = dict(os.environ)
    environment.pop("DISPLAY", None)
    return subprocess.Popen(
        [program("snapshot"), *map(str, arguments)],
        env=environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        universal_newlines=True,
        start_new_session=True,
    )


def snapshot_listens():
    """Tell whether a snapshot hears the robot."""
    _, subscribers, _ = rosgraph.Master("/test").getSystemState()
    nodes = dict(subscribers).get("/robot_state", [])
    return any(re.fullmatch(r"/snapshot_\d+_\d+", node) for node in nodes)


class TestSnapshot(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.commands = rospy.Publisher("/joint_commands", JointState, queue_size=1)
        wait_for(cls.commands.get_num_connections, "the bridge to listen")
        cls.states = Connected("/joint_states", JointState, queue_size=1)
        cls.states.wait()

    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.folder = Path(folder.name)

    def run_snapshot(self, *arguments, expected=0):
        process = start(self.folder / arguments[0], *arguments[1:])
        out, err = process.communicate(timeout=DEADLINE)
        self.assertNotIn("Traceback", err)
        self.assertEqual(process.returncode, expected, err)
        return out, err

    def picture(self, *arguments):
        self.run_snapshot("a.png", "--view", "front", *arguments)
        return read_frames(self.folder / "a.png")[0][0].astype(int)

    def move(self, **positions):
        """Send joints somewhere, and return when they are there."""
        self.states.clear()
        self.commands.publish(
            JointState(name=[*positions], position=[*positions.values()])
        )

        def there(message):
            now = dict(zip(message.name, message.position))
            return all(abs(now[name] - p) < 1e-9 for name, p in positions.items())

        self.states.wait(there, f"joints at {positions}")

    def test_a_picture_shows_what_a_command_did(self):
        self.move(left_shoulder_roll_joint=0.0)
        before = self.picture("--size", "320x240")
        self.assertEqual(before.shape, (240, 320, 3))
        self.move(left_shoulder_roll_joint=1.4)
        self.addCleanup(self.move, left_shoulder_roll_joint=0.0)
        after = self.picture("--size", "320x240")
        self.assertGreater((np.abs(after - before).max(axis=2) > 30).sum(), 300)

    def test_the_floor_is_that_of_the_map(self):
        """A robot in the air is seen without the shadow at its feet."""
        standing = self.picture("--size", "320x240")
        service = rospy.ServiceProxy("/gazebo/set_model_state", SetModelState)

        def lift(height):
            pose = Pose(Point(0, 0, height), Quaternion(0, 0, 0, 1))
            self.assertTrue(service(ModelState(model_name="g1_robot", pose=pose)))

        lift(20.0)
        self.addCleanup(lift, 0.793)
        flying = self.picture("--size", "320x240")
        below = slice(225, 240)
        self.assertTrue((standing[below] != flying[below]).any())

    def test_a_film_shows_the_robot_moving(self):
        def swing():
            angle = 0.7 + 0.6 * np.sin(2.0 * time.monotonic())
            self.commands.publish(
                JointState(name=["left_shoulder_roll_joint"], position=[angle])
            )

        film = ("--gif", "--seconds", "2", "--fps", "10", "--size", "160x120")
        with closing(Repeated(swing, 0.02)):
            _, err = self.run_snapshot("a.gif", *film)
        self.assertIn("frame 20 of 20", err)
        frames, lengths = read_frames(self.folder / "a.gif")
        self.assertEqual(frames.shape[1:], (120, 160, 3))
        self.assertEqual(lengths.sum(), 2000)
        self.assertGreater(len(frames), 15)  # equal ones are one
        self.assertGreater(len(np.unique(frames, axis=0)), 10)

    def test_what_is_not_known_is_told(self):
        publisher = rospy.Publisher("/half/joint_states", JointState, queue_size=1)
        over = threading.Event()

        def say():
            message = JointState(name=["left_knee_joint"], position=[1.0])
            while not over.wait(0.05):
                publisher.publish(message)

        speaker = threading.Thread(target=say)
        speaker.start()
        try:
            _, err = self.run_snapshot(
                "a.png", "--namespace", "half", "--size", "64x48"
            )
        finally:
            over.set()
            speaker.join()
        told = [line for line in err.splitlines() if "drawn at 0" in line]
        self.assertEqual(len(told), 1)
        self.assertIn("right_knee_joint", told[0])
        self.assertNotIn("left_knee_joint", told[0])
        self.assertIn("nor TF has the pose of half/pelvis in map", err)

    def test_joints_that_never_come_are_told(self):
        _, err = self.run_snapshot("a.png", "--namespace", "half", expected=1)
        self.assertIn(
            "There were no joint states of 'g1_29dof' on /half/joint_states", err
        )
        self.assertEqual(list(self.folder.iterdir()), [])

    def test_a_clock_that_stands_still_is_told(self):
        rospy.wait_for_service("/gazebo/pause_physics", DEADLINE)
        unpause = rospy.ServiceProxy("/gazebo/unpause_physics", Empty)
        process = start(self.folder / "a.gif", "--gif", "--seconds", "60")
        wait_for(snapshot_listens, "snapshot to listen")
        rospy.ServiceProxy("/gazebo/pause_physics", Empty)()
        self.addCleanup(unpause)
        _, err = process.communicate(timeout=DEADLINE)
        self.assertEqual(process.returncode, 1)
        self.assertRegex(err, "The clock did not advance|no joint states")
        self.assertEqual(list(self.folder.iterdir()), [])

    def test_a_film_may_wait_long_for_its_next_picture(self):
        film = ("--gif", "--seconds", "24", "--fps", "0.08", "--size", "64x48")
        _, err = self.run_snapshot("a.gif", *film)
        self.assertIn("frame 2 of 2", err)

    def test_a_film_goes_on_after_a_reset(self):
        """The clock is put back so often that it never comes to the next picture."""
        reset = rospy.ServiceProxy("/gazebo/reset_simulation", Empty)
        reset()

        def put_back():
            if rospy.get_time() > 0.5:
                reset()

        film = ("--gif", "--seconds", "3", "--fps", "1", "--size", "64x48")
        with closing(Repeated(put_back, 0.01)):
            _, err = self.run_snapshot("a.gif", *film)
        self.assertIn("frame 3 of 3", err)
        self.assertNotIn("TF_", err)

    def test_an_interrupt_ends_it_and_leaves_nothing(self):
        process = start(self.folder / "a.gif", "--gif", "--seconds", "60")
        wait_for(snapshot_listens, "snapshot to listen")
        os.killpg(process.pid, signal.SIGINT)
        _, err = process.communicate(timeout=DEADLINE)
        self.assertEqual(process.returncode, 130, err)
        self.assertNotIn("Traceback", err)
        self.assertIn("nothing is written", err)
        self.assertEqual(list(self.folder.iterdir()), [])
