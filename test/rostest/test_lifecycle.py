"""The bridge starts before the simulator, survives its end, and follows resets.

Stamps rise through all of it, and nobody who listens to TF complains.
"""

import os
import signal
import time
import unittest

import numpy as np
import rosnode
import rospy
from g1_description.srv import Step
from gazebo_msgs.msg import LinkStates, ModelState
from gazebo_msgs.srv import GetJointProperties, GetModelState, SetModelState
from geometry_msgs.msg import Point, Pose, Quaternion, TransformStamped
from sensor_msgs.msg import JointState
from std_srvs.srv import Empty
from support.programs import Program
from support.ros_testing import (
    Launch,
    Listener,
    NodeLog,
    Repeated,
    is_at,
    process_of,
    step_by,
    wait_for,
)
from support.stamp_record import LISTENERS, SECOND, Others, Record, splits
from tf2_msgs.msg import TFMessage

ELBOW, KNEE = "left_elbow_joint", "left_knee_joint"
PLACE = "x:=1", "z:=1", "Y:=0.5", "initial_pose:=stand"
BASE = "base_link"
"""The frame that the bridge itself moves."""
LONG = 11.0
"""Simulated time in [s] that is more than TF remembers."""
OLD = 45.0
"""Simulated time in [s] after which states of a new simulator seem old."""
STEP = 0.01
"""[s]"""


class Moving(unittest.TestCase):
    """A robot that moves all the time, and a record of what comes."""

    @classmethod
    def setUpClass(cls):
        cls.commands = rospy.Publisher("/joint_commands", JointState, queue_size=10)
        cls.model = rospy.Publisher("/gazebo/set_model_state", ModelState, queue_size=1)
        cls.states = Listener("/joint_states", JointState)
        cls.record = Record()
        for one in (cls.states, cls.record):
            cls.addClassCleanup(one.close)

    def setUp(self):
        self.moves = 0

    def dance(self):
        """Move the robot and a joint by more than what is worth sending."""
        self.moves += 1
        part = 0.01 * (self.moves % 100)
        self.command(ELBOW, part)
        state = ModelState(model_name="g1_robot", reference_frame="world")
        state.pose.position.x, state.pose.position.z = part, 0.793
        state.pose.orientation.w = 1.0
        self.model.publish(state)

    @classmethod
    def command(cls, name, position):
        cls.commands.publish(JointState(name=[name], position=[position]))

    def wait_for_joint(self, name, position):
        """Wait for a joint, from now on."""
        self.states.clear()
        return self.states.wait(
            lambda m: is_at(m, name, position), f"{name} at {position}"
        )

    def run_for(self, seconds):
        """Let simulated time pass, by the stamps of joint states."""
        self.states.clear()
        end = self.states.wait().header.stamp + rospy.Duration(seconds)
        self.states.wait(lambda m: m.header.stamp > end, "the time")

    def pause(self):
        """Pause until some joint states have come of what is commanded meanwhile."""
        rospy.ServiceProxy("/gazebo/pause_physics", Empty)()
        before = len(self.record.joints())
        wait_for(lambda: len(self.record.joints()) > before + 10, "joint states")

    def go_on(self):
        rospy.ServiceProxy("/gazebo/unpause_physics", Empty)()

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


class TestLifecycle(Moving):
    @classmethod
    def setUpClass(cls):
        super().setUpClass()
        cls.addClassCleanup(Launch("bridge.launch", "rate:=20").stop)
        wait_for(cls.commands.get_num_connections, "the bridge to listen")
        cls.command(ELBOW, 0.625)
        cls.launch = Launch("gazebo.launch", "respawn_gazebo:=true", "rate:=20", *PLACE)
        cls.addClassCleanup(cls.launch.stop)

    def test_1_a_command_from_before_the_simulator_arrives(self):
        self.wait_for_joint(ELBOW, 0.625)
        wait_for(lambda: len(self.record.frames()) == 30, "the frames of all links")
        wait_for(lambda: self.is_in_place(), "the robot")

    def is_in_place(self):
        """Look whether the robot is where and how the launch file has it."""
        state = rospy.ServiceProxy("/gazebo/get_model_state", GetModelState)
        joint = rospy.ServiceProxy("/gazebo/get_joint_properties", GetJointProperties)
        try:
            pose = state("g1_robot", "").pose
            knee = joint(KNEE)
        except rospy.ServiceException:
            return False
        there = pose.position.x, pose.position.z, pose.orientation.z, *knee.position
        wanted = 1.0, 1.0, np.sin(0.25), 0.6
        return np.allclose(there, wanted) if len(there) == len(wanted) else False

    def test_2_stamps_rise_through_resets_and_pauses_and_nobody_complains(self):
        """Those who are slow only see time go back if it stands still then."""
        step_by(STEP)
        self.wait_for_joint(KNEE, 0.6)
        self.record.clear()
        others = Others()
        self.addCleanup(others.close)
        dancing = Repeated(self.dance, 0.05)
        self.addCleanup(dancing.close)
        self.run_for(1.0)
        self.command(KNEE, 1.0)
        last = self.wait_for_joint(KNEE, 1.0).header.stamp.to_sec()
        self.pause()
        # Beyond the ten seconds that TF remembers, older data could be refused.
        step = rospy.ServiceProxy("/gazebo/step", Step)
        self.assertTrue(step(round(LONG / STEP)).success)
        self.states.wait(lambda m: m.header.stamp.to_sec() > last + LONG, "the steps")
        reset = rospy.ServiceProxy("/gazebo/reset_simulation", Empty)
        self.jump(reset)
        wait_for(lambda: min(others.jumps()) == 1, "all to see time go back")
        self.wait_for_joint(KNEE, 0.6)
        self.assertLess(self.states.messages[-1].header.stamp.to_sec(), 0.5)
        self.go_on()
        self.run_for(1.0)
        self.pause()
        self.go_on()
        self.run_for(0.5)
        self.check_stamps(jumps=1)
        self.assertEqual(others.trouble(), {})
        self.assertEqual(self.record.trouble(), [])
        self.jump(reset)  # while time runs
        self.run_for(0.5)
        self.check_stamps(jumps=2)

    def test_3_reset_world_keeps_time_and_joints_and_takes_the_robot_home(self):
        self.command(KNEE, 1.25)
        before = self.wait_for_joint(KNEE, 1.25).header.stamp
        find = rospy.ServiceProxy("/gazebo/get_model_state", GetModelState)
        away = ModelState(
            model_name="g1_robot", pose=Pose(Point(3, 2, 1), Quaternion(w=1))
        )
        rospy.ServiceProxy("/gazebo/set_model_state", SetModelState)(away)
        self.assertEqual(find("g1_robot", "").pose.position, Point(3, 2, 1))
        rospy.ServiceProxy("/gazebo/reset_world", Empty)()
        self.assertEqual(find("g1_robot", "").pose.position, Point(1, 0, 1))
        after = self.wait_for_joint(KNEE, 1.25).header.stamp
        self.assertGreater(after, before)

    def test_4_a_simulator_that_is_killed_comes_back_with_its_robot(self):
        """It tells its time before its states.

        robot_state_publisher complains of states 30 s older than its clock.
        """
        node = "/robot_state_publisher"
        log = NodeLog(node)
        self.addCleanup(log.close)
        rospy.ServiceProxy("/gazebo/pause_physics", Empty)()
        step = rospy.ServiceProxy("/gazebo/step", Step)
        self.assertTrue(step(round(OLD / STEP)).success)
        wait_for(lambda: rospy.Time.now().to_sec() > OLD, "an old clock")
        self.states.wait(lambda m: m.header.stamp.to_sec() > OLD, "states of then")
        log.clear()
        self.record.clear()
        self.command(ELBOW, 0.25)
        self.wait_for_joint(ELBOW, 0.25)
        wait_for(lambda: BASE in self.record.frames(), "the base")
        pid = process_of("/gazebo")

        def kill():
            os.kill(pid, signal.SIGKILL)
            self.command(ELBOW, 0.375)

        self.jump(kill)
        self.assertNotIn(process_of("/gazebo"), (None, pid))
        self.assertEqual(len(self.wait_for_joint(ELBOW, 0.375).name), 29)
        wait_for(self.is_in_place, "the robot")
        self.command("right_elbow_joint", 0.5)
        self.wait_for_joint("right_elbow_joint", 0.5)
        log.wait(
            lambda m: m.name == node and "Moved backwards in time" in m.msg,
            "the new time",
        )
        told = [m.msg for m in log.messages if m.name == node]
        self.assertFalse([line for line in told if "seconds old" in line], told)
        self.check_stamps(jumps=1)

    def test_5_a_node_says_that_another_one_took_its_name(self):
        command = "gazebo_stand_in.py", "__name:=second"
        command += "__ns:=/other", "/clock:=/other/clock"
        first = Program(*command)
        self.addCleanup(first.kill)
        wait_for(lambda: process_of("/other/second") == first.pid, "the first")
        # What it registered from now on would end the second one instead. It publishes
        # states when it has registered everything.
        states = Listener("/other/second/link_states", LinkStates)
        states.wait()
        second = Program(*command)
        self.addCleanup(second.kill)
        _, said = first.communicate()
        self.assertIn("another node named /other/second has started", said)
        self.assertNotIn("Traceback", said)
        second.terminate()
        second.wait()

    def test_6_the_bridge_outlives_the_simulator(self):
        self.launch.stop()
        wait_for(lambda: process_of("/gazebo") is None, "its end")
        self.assertIn("/link_states_bridge", rosnode.get_node_names())


class TestWallTime(Moving):
    @classmethod
    def setUpClass(cls):
        super().setUpClass()
        rospy.set_param("/use_sim_time", False)
        cls.addClassCleanup(rospy.set_param, "/use_sim_time", True)

    def test_1_those_who_listen_tell_when_a_stamp_comes_twice(self):
        """Else their silence would tell nothing."""
        others = Others("/repeated")
        self.addCleanup(others.close)
        publisher = rospy.Publisher("/repeated", TFMessage, queue_size=1)
        self.addCleanup(publisher.unregister)
        edge = TransformStamped(child_frame_id="pelvis")
        edge.header.frame_id, edge.header.stamp = "map", rospy.Time(time.time())
        edge.transform.rotation.w = 1.0
        wait_for(
            lambda: (
                publisher.publish(TFMessage([edge]))
                or len(others.trouble()) == len(LISTENERS)
            ),
            "all to complain",
        )

    def test_2_stamps_are_those_of_the_wall_and_rise(self):
        before = time.time()
        options = "rviz:=false", "rate:=20", "use_sim_time:=false"
        self.addCleanup(Launch("display.launch", *options).stop)
        wait_for(lambda: len(self.record.frames()) == 30, "the frames of all links")
        others = Others()
        self.addCleanup(others.close)
        self.addCleanup(Repeated(self.dance, 0.05).close)
        self.run_for(2.0)
        stamps = self.record.joints()
        self.assertTrue(before < stamps[-1] / SECOND <= time.time())
        self.assertEqual(stamps, sorted(set(stamps)))
        self.check_stamps(jumps=0)
        self.assertEqual(others.trouble(), {})
        self.assertEqual(self.record.trouble(), [])
