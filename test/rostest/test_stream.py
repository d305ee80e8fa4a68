"""g1_description.Stream, and the messages that Robot makes, on a robot that runs."""

import os
import signal
import subprocess
import sys
import threading
import unittest
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import rospy
from g1_description.msg import RobotState, RobotTrajectory
from sensor_msgs.msg import JointState
from std_srvs.srv import Empty
from support.programs import Program
from support.ros_testing import (
    DEADLINE,
    Connected,
    Listener,
    wait_for,
)

from g1_description import Robot, Stream
from g1_description.errors import G1DescriptionError, UnknownNameError
from g1_description.ros.conversions import pose_to_array
from g1_description.ros.log import ThrottledLog
from g1_description.ros.robot_states import JoinedStates, RobotStates
from g1_description.ros.waiting import NoAnswerError

ROBOT = Robot()
FEET = ("left_ankle_roll_link", "right_ankle_roll_link")
PERIOD = 0.02
"""Of the states and of the streams, in [s]."""


def is_down(state, squat):
    """Tell whether a state shows the middle of the squat."""
    return bool(np.abs(squat.positions[150] - state.position).max() < 1e-9)


def sample_of(state, motion):
    """Give the sample of a motion that a state shows, or None: within 1e-9 rad."""
    errors = np.abs(motion.positions - state.position).max(axis=1)
    return int(errors.argmin()) if errors.min() < 1e-9 else None


class TestStream(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.states = Connected("/robot_state", RobotState)
        cls.addClassCleanup(cls.states.close)

    def test_base_and_joints_arrive_together_and_a_recording_passes_its_checks(self):
        """Streamed configurations have no velocities: their zeros must not count."""
        squat = ROBOT.read_motion("squat.csv")
        file = Path(self.folder(), "streamed.csv")
        with Stream(rate=50) as stream:
            stream.send(squat.positions[0], squat.base[0])
            record = Program("record", file)
            self.assertIn("recording", record.stderr.readline())
            self.states.clear()
            times = [stream.send(*row) for row in zip(squat.positions, squat.base)]
        self.states.wait(lambda m: is_down(m, squat))
        record.send_signal(signal.SIGINT)
        self.assertEqual(record.wait(), 0, record.communicate())
        self.assertEqual(stream.robot.joint_names, ROBOT.joint_names)
        # A busy machine takes longer; never shorter.
        self.assertGreater(times[-1] - times[0], PERIOD * (len(times) - 21))
        shown = [m for m in self.states.messages if sample_of(m, squat) is not None]
        self.assertGreater(len({sample_of(m, squat) for m in shown}), 50)
        bases = [pose_to_array(m.base_pose) for m in shown]
        poses = ROBOT.link_poses([m.position for m in shown], bases)
        for foot in FEET:
            self.assertLess(np.ptp(poses[foot], axis=0).max(), 4e-4)
        self.assertNotIn(".velocity", file.read_text())
        verdict = ROBOT.check(file, only=["drift", "skating"])
        self.assertEqual(verdict.findings, ())
        self.assertGreater(verdict.figures["contact_share"], 0.99)

    def test_a_program_may_listen_to_the_same_topics(self):
        """Rospy gives all subscribers of a topic the class of the first one."""
        log, changed = ThrottledLog(), threading.Event()
        joined = JoinedStates(
            "map", "base_link", 0.0, log, "/joint_states", changed, threading.Event()
        )
        self.addCleanup(joined.close)
        later = Connected("/joint_states", JointState)
        self.addCleanup(later.close)
        self.assertEqual(len(later.wait().position), len(ROBOT.joint_names))
        wait_for(joined.newest, "joint states with a base")
        # The class listened before.
        states = RobotStates("map", "base_link", 0.0, log, changed=changed)
        self.addCleanup(states.close)
        wait_for(lambda: states.is_published and states.newest(), "a state")

    def folder(self):
        """Give a folder that goes with the test; enterContext is new in Python 3.11."""
        folder = TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        return folder.name

    def test_what_is_not_named_stays(self):
        before = self.states.messages[-1]
        with Stream() as stream:
            stream.send({"left_elbow_joint": 1.25})
        elbow = before.name.index("left_elbow_joint")
        after = self.states.wait(lambda m: abs(m.position[elbow] - 1.25) < 1e-9)
        rest = [*after.position[:elbow], *after.position[elbow + 1 :]]
        kept = [*before.position[:elbow], *before.position[elbow + 1 :]]
        np.testing.assert_allclose(rest, kept, atol=1e-9)
        np.testing.assert_allclose(
            pose_to_array(after.base_pose), pose_to_array(before.base_pose), atol=1e-9
        )

    def test_what_is_wrong_is_told_before_anything_is_sent(self):
        motions = Listener("/motion", RobotTrajectory)
        with Stream() as stream:
            with self.assertRaisesRegex(UnknownNameError, "left_elbow_joint"):
                stream.send({"left_elbo_joint": 1.0})
            with self.assertRaisesRegex(G1DescriptionError, "length 1"):
                stream.send(base=[0, 0, 0.8, 1, 1, 0, 0])
        self.assertEqual(motions.messages, [])
        motions.close()

    def test_time_that_stands_still_is_told(self):
        rospy.ServiceProxy("/gazebo/pause_physics", Empty)()
        try:
            with self.assertRaisesRegex(NoAnswerError, "stands still at .*paused"):
                Stream(timeout=1.0)
        finally:
            rospy.ServiceProxy("/gazebo/unpause_physics", Empty)()

    def test_a_simulator_that_stops_ends_the_stream(self):
        pause = rospy.ServiceProxy("/gazebo/pause_physics", Empty)
        self.addCleanup(rospy.ServiceProxy("/gazebo/unpause_physics", Empty))
        told = self.assertRaisesRegex(NoAnswerError, "stands still at .*running")
        with told as end, Stream(timeout=1.0) as stream:
            stream.send({"left_elbow_joint": 0.0})
            pause()
            for _ in range(3):  # the next one may be due already
                stream.send({"left_elbow_joint": 0.1})
        self.assertIsNone(end.exception.__context__)  # it did not wait again

    def test_a_robot_that_is_not_there_is_told(self):
        with self.assertRaisesRegex(NoAnswerError, "subscribes to /nobody/motion"):
            Stream(namespace="/nobody/", timeout=0.5)
        urdf = rospy.get_param("/robot_description")
        self.addCleanup(rospy.set_param, "/robot_description", urdf)
        rospy.delete_param("/robot_description")
        with self.assertRaisesRegex(NoAnswerError, "robot_description in /nobody or"):
            Stream(namespace="nobody", timeout=0.5)

    def test_a_robot_is_found_from_its_namespace_upward(self):
        """With the profile of the launch; a node's own namespace is not in between."""
        for topic in ("/left/motion", "/profiled/motion"):
            self.addCleanup(Listener(topic, RobotTrajectory).close)
        self.addCleanup(rospy.delete_param, "/profiled")
        rospy.set_param("/profiled/robot_description_profile", "g1_23dof")
        urdf = rospy.get_param("/robot_description")
        rospy.set_param("/profiled/robot_description", urdf)
        program = """if True:
            import rospy
            from g1_description import Stream
            rospy.init_node("streams")
            for namespace in ("left", "/left", ""):
                print(Stream(namespace=namespace, timeout=9).robot.profile.name)"""
        run = subprocess.run(
            [sys.executable, "-c", program],
            env={**os.environ, "ROS_NAMESPACE": "profiled"},
            capture_output=True,
            text=True,
            timeout=DEADLINE,
        )
        names = ["g1_29dof", "g1_29dof", "g1_23dof"]
        self.assertEqual(run.stdout.split(), names, run.stderr)
