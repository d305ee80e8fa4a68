"""A motion is shown without a simulator: its joints and its base, as the file says."""

import signal
import subprocess
import tempfile
import unittest
from pathlib import Path

import rosbag
import rospy
import tf2_ros
from geometry_msgs.msg import TransformStamped
from rosgraph_msgs.msg import Log
from sensor_msgs.msg import JointState
from support.bridge.arm import URDF
from support.ros_testing import (
    DEADLINE,
    REPOSITORY,
    Connected,
    Launch,
    Listener,
    program,
    wait_for,
)
from tf2_msgs.msg import TFMessage

G1 = REPOSITORY / "urdf" / "g1_29dof.urdf"
MOTION = REPOSITORY / "test" / "data" / "elbow.csv"
ELBOW = "left_elbow_joint"
SPEED = 0.5
"""Of the base along y in [m/s], while the elbow turns by -1 rad/s."""


def start(test, *arguments):
    launch = Launch("replay.launch", "rviz:=false", *arguments)
    test.addCleanup(launch.stop)
    return launch


class TestReplay(unittest.TestCase):
    def test_base_and_joints_are_those_of_the_motion_again_and_again(self):
        log = Listener("/rosout", Log)
        self.addCleanup(log.close)
        start(self, f"motion:={MOTION}", "speed:=0.5")
        states = Connected("/joint_states", JointState)
        self.addCleanup(states.close)
        frames = Connected("/tf", TFMessage)
        self.addCleanup(frames.close)
        log.wait(lambda m: "11 samples, 1.00 s" in m.msg, "what is shown")

        def begins():
            """Count how often the robot is seen to jump back."""
            places = [y for _, y in self.places(frames)]
            return sum(new < old - 0.1 for old, new in zip(places, places[1:]))

        wait_for(lambda: begins() >= 2, "the motion twice")
        elbows = {
            message.header.stamp: (message.position[n], message.velocity[n])
            for message in list(states.messages)
            for n in (message.name.index(ELBOW),)
        }
        compared = moving = 0
        for stamp, y in self.places(frames):
            if stamp in elbows:
                position, velocity = elbows[stamp]
                self.assertAlmostEqual(position, -y / SPEED, delta=1e-9)
                is_moving = 0.0 < y < SPEED
                # The motion's own is -1 rad/s, and it is shown at half its speed.
                self.assertAlmostEqual(velocity, -0.5 if is_moving else 0.0, delta=1e-9)
                compared, moving = compared + 1, moving + is_moving
        self.assertGreater(moving, 20)
        self.assertGreater(compared, moving)

    @staticmethod
    def places(frames):
        """List stamps and places along y of the base."""
        return [
            (edge.header.stamp, edge.transform.translation.y)
            for message in list(frames.messages)
            for edge in message.transforms
            if edge.child_frame_id == "base_link"
        ]

    def test_it_stays_at_its_end_and_all_frames_are_there(self):
        start(self, f"motion:={MOTION}", "loop:=false", "speed:=5.0")
        buffer = tf2_ros.Buffer()
        listener = tf2_ros.TransformListener(buffer)
        self.addCleanup(listener.unregister)

        def place(parent, child):
            try:
                found = buffer.lookup_transform(parent, child, rospy.Time())
            except tf2_ros.TransformException:
                return None
            return found.transform.translation

        def is_at_end():
            found = place("map", "pelvis")
            return found and abs(found.y - SPEED) < 1e-9 and abs(found.z - 0.793) < 1e-9

        wait_for(is_at_end, "the base at the end of the motion")
        wait_for(lambda: place("world", "left_wrist_yaw_link"), "the hand")
        self.assertGreater(place("world", "left_wrist_yaw_link").y, SPEED)

    def test_a_bag_is_shown(self):
        edge = TransformStamped(child_frame_id="base_link")
        edge.header.frame_id, edge.transform.rotation.w = "map", 1.0
        edge.header.stamp = rospy.Time(1)
        edge.transform.translation.x = 2.5
        states = JointState(name=[ELBOW], position=[0.75])
        states.header.stamp = edge.header.stamp
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        file = Path(folder.name) / "a.bag"
        with rosbag.Bag(str(file), "w", compression="bz2") as bag:
            bag.write("/left/joint_states", states, rospy.Time(1))
            bag.write("/tf", TFMessage([edge]), rospy.Time(1))
        shown = Listener("/joint_states", JointState)
        self.addCleanup(shown.close)
        frames = Listener("/tf", TFMessage)
        self.addCleanup(frames.close)
        start(self, f"bag:={file}", "topic:=left/joint_states")
        shown.wait(lambda m: m.position[m.name.index(ELBOW)] == 0.75, "the elbow")
        frames.wait(
            lambda m: any(e.transform.translation.x == 2.5 for e in m.transforms),
            "the base",
        )

    def test_what_is_no_motion_ends_the_launch_with_a_sentence(self):
        launch = start(self, "motion:=nothing.csv")
        wait_for(lambda: launch.exit_code is not None, "the end of the launch")

    def test_joints_that_do_not_move_are_told_once(self):
        rospy.set_param("/robot_description", G1.read_text())
        run = subprocess.Popen(
            [program("replay.py"), f"_motion:={MOTION}", "_fps:=0.0"],
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )
        told = ""
        while "11 samples" not in told:
            line = run.stdout.readline()
            self.assertTrue(line, told)
            told += line
        run.send_signal(signal.SIGINT)
        run.communicate(timeout=DEADLINE)
        self.assertEqual(told.count("left_hip_pitch_joint"), 1)

    def test_what_is_no_motion_is_told(self):
        rospy.set_param("/robot_description", URDF)
        for words, arguments in (
            ("No motion file; give motion:=FILE or bag:=FILE.", ()),
            (
                "motion:= and bag:= cannot be combined.",
                (f"_motion:={MOTION}", f"_bag:={MOTION}"),
            ),
            ("elbow.csv: Not a rosbag", (f"_bag:={MOTION}", "_topic:=motion")),
            (
                "must be an absolute path (got 'nothing.csv'); try $PWD/nothing.csv.",
                ("_motion:=nothing.csv",),
            ),
            (
                "~speed must be from 0.001 to 1000.0 (got 0.0).",
                (f"_motion:={MOTION}", "_speed:=0"),
            ),
            ("none of the motion's joints", (f"_motion:={MOTION}",)),
        ):
            with self.subTest(words):
                if rospy.has_param("/replay"):
                    rospy.delete_param("/replay")
                run = subprocess.run(
                    [program("replay.py"), *arguments],
                    stdout=subprocess.PIPE,
                    stderr=subprocess.STDOUT,
                    text=True,
                    timeout=DEADLINE,
                )
                self.assertIn(words, run.stdout)
                self.assertNotIn("Traceback", run.stdout)
                self.assertEqual(run.returncode, 1)
