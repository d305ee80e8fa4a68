"""Stamps are honest, and never repeated on /tf, whatever happens to the time."""

import os
import signal
import time
import unittest

import rospy
from gazebo_msgs.msg import ModelState
from geometry_msgs.msg import TransformStamped
from sensor_msgs.msg import JointState
from std_srvs.srv import Empty
from support.bridge.arm import URDF, arm_states
from support.bridge.watched import Watched
from support.burners import Burners
from support.ros_testing import (
    DEADLINE,
    Launch,
    Listener,
    Repeated,
    process_of,
    wait_for,
)
from support.stamp_record import LISTENERS, SECOND, Others, Record, splits
from tf2_msgs.msg import TFMessage

from tcpros import body_of

BASE = "base_link"
"""The frame that the bridge itself moves."""


class TestBridgeTime(unittest.TestCase):
    maxDiff = None

    @classmethod
    def setUpClass(cls):
        cls.seconds = rospy.get_param("~seconds")
        cls.commands = rospy.Publisher("/joint_commands", JointState, queue_size=1)
        cls.model = rospy.Publisher("/gazebo/set_model_state", ModelState, queue_size=1)
        cls.steps = 0

    def start(self, *arguments):
        """Launch the display, let the robot dance, and record what comes."""
        launch = Launch("display.launch", "rviz:=false", *arguments)
        self.addCleanup(launch.stop)
        self.record = Record()
        self.addCleanup(self.record.close)
        wait_for(self.record.joints, "joint states")
        wait_for(lambda: len(self.record.frames()) == 30, "the frames of all links")
        self.addCleanup(Repeated(self.dance, 0.01).close)
        self.record.clear()

    def burn(self):
        self.addCleanup(Burners().close)

    def let_others_listen(self):
        """Let other programs listen to TF."""
        others = Others()
        self.addCleanup(others.close)
        return others

    def dance(self):
        """Move the robot and a joint by more than what is worth sending."""
        TestBridgeTime.steps += 1
        share = 0.01 * (self.steps % 100)
        self.commands.publish(JointState(name=["left_elbow_joint"], position=[share]))
        state = ModelState(model_name="g1_robot", reference_frame="world")
        state.pose.position.x, state.pose.position.z = share, 0.793
        state.pose.orientation.w = 1.0
        self.model.publish(state)

    def run_for(self, share):
        """Let a share of the whole time pass, by the stamps of joint states."""
        stamps = wait_for(self.record.joints, "joint states")
        end = stamps[-1] + share * self.seconds * SECOND
        wait_for(
            lambda: self.record.joints()[-1] > end,
            "the time",
            DEADLINE + 5 * self.seconds,
        )

    def wait_for_more(self):
        """Wait for some more joint states."""
        before = len(self.record.joints())
        wait_for(lambda: len(self.record.joints()) > before + 20, "joint states")

    def pause(self):
        """Pause until some joint states have come of what is commanded meanwhile."""
        rospy.ServiceProxy("/gazebo/pause_physics", Empty)()
        self.wait_for_more()
        rospy.ServiceProxy("/gazebo/unpause_physics", Empty)()

    def reset(self):
        """Let the time go back to zero."""
        self.jump(rospy.ServiceProxy("/gazebo/reset_simulation", Empty))

    def jump(self, act):
        """Let the time go back; states and base must come again."""
        before = len(splits(self.record.joints()))
        act()

        def have_jumped():
            both = self.record.joints(), self.record.frames()[BASE]
            return all(len(splits(stamps)) == before + 1 for stamps in both)

        wait_for(have_jumped, "joint states and base after the jump")

    def check_stamps(self, jumps):
        """No stamp comes twice on /tf, and the base comes with the first states."""
        joints = splits(self.record.joints())
        bases = splits(self.record.frames()[BASE])
        self.assertEqual((len(joints), len(bases)), (jumps + 1, jumps + 1))
        self.assertEqual(self.record.not_rising(), {})
        for life, base in zip(joints[1:], bases[1:]):
            self.assertIn(base[0], life[:2])

    def test_those_who_listen_tell_when_a_stamp_comes_twice(self):
        """Else their silence would tell nothing."""
        rospy.set_param("/use_sim_time", False)
        others = Others("/repeated")
        self.addCleanup(others.close)
        publisher = rospy.Publisher("/repeated", TFMessage, queue_size=1)
        self.addCleanup(publisher.unregister)
        edge = TransformStamped(child_frame_id="pelvis")
        edge.header.frame_id, edge.header.stamp = "map", rospy.Time.now()
        edge.transform.rotation.w = 1.0
        wait_for(
            lambda: (
                publisher.publish(TFMessage([edge]))
                or len(others.trouble()) == len(LISTENERS)
            ),
            "all to complain",
        )

    def test_resets_a_pause_and_a_new_simulator(self):
        self.start("respawn_gazebo:=true")
        self.burn()
        for _ in range(2):
            self.run_for(0.1)
            self.reset()
        self.pause()
        self.run_for(0.05)
        self.check_stamps(jumps=2)
        pid = process_of("/gazebo")
        self.jump(lambda: os.kill(pid, signal.SIGKILL))
        self.run_for(0.1)
        self.check_stamps(jumps=3)

    def test_those_who_listen_are_silent_after_a_reset(self):
        """Those who are slow only see time go back if it stands still then."""
        self.start()
        others = self.let_others_listen()
        # Beyond the ten seconds that TF remembers, older data could be refused.
        self.run_for(0.55)
        self.assertEqual(others.trouble(), {})
        rospy.ServiceProxy("/gazebo/pause_physics", Empty)()
        self.wait_for_more()
        self.reset()
        wait_for(lambda: min(others.jumps()) == 1, "all to see time go back")
        rospy.ServiceProxy("/gazebo/unpause_physics", Empty)()
        self.run_for(0.1)
        self.pause()
        self.run_for(0.05)
        self.check_stamps(jumps=1)
        self.assertEqual(others.trouble(), {})
        self.assertEqual(self.record.trouble(), [])

    def test_the_time_of_the_wall(self):
        before = time.time()
        self.start("use_sim_time:=false")
        self.burn()
        others = self.let_others_listen()
        self.run_for(0.15)
        stamps = self.record.joints()
        self.assertTrue(before < stamps[-1] / SECOND <= time.time())
        self.assertEqual(stamps, sorted(set(stamps)))
        self.check_stamps(jumps=0)
        self.assertEqual(others.trouble(), {})
        self.assertEqual(self.record.trouble(), [])

    def test_the_time_of_the_wall_without_any_clock(self):
        rospy.set_param("/use_sim_time", False)
        rospy.set_param("/robot_description", URDF)
        watched = Watched("/wall", has_clock=False)
        self.addCleanup(watched.bridge.kill)
        self.addCleanup(watched.close)
        frames = Listener("/tf", TFMessage)
        self.addCleanup(frames.close)
        for number in range(100):
            before = time.time()
            positions = {"shoulder": 0.001 * number, "elbow": 0.5, "slide": 0.1}
            message = watched.show(arm_states(**positions), positions)
            stamp = message.header.stamp.to_sec()
            self.assertTrue(before - 1e-3 <= stamp <= time.time() + 1e-3)
        before = time.time()
        frames.clear()
        last = wait_for(
            lambda: watched.send(body_of(arm_states())) or frames.messages, "base_link"
        )[-1].transforms[0]
        self.assertEqual(last.child_frame_id, "base_link")
        self.assertTrue(before - 60.0 < last.header.stamp.to_sec() <= time.time())
