"""The bridge starts before the simulator, survives its end, and follows resets."""

import os
import signal
import subprocess
import unittest
from pathlib import Path

import rosnode
import rospy
from g1_description.srv import SetRealTimeFactor
from gazebo_msgs.msg import LinkStates
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from std_srvs.srv import Empty
from support.ros_testing import (
    DEADLINE,
    Launch,
    Listener,
    NodeLog,
    position_of,
    process_of,
    processor_time,
    program,
    wait_for,
)
from tf2_msgs.msg import TFMessage

OLD = 45.0
"""Simulated time in [s] after which states of a new simulator seem old."""


def has_ended(pid):
    """Ask the system; a node that shuts down may leave a question unanswered."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0] == "Z"
    except OSError:
        return True


MOMENTS = 10
"""Between the start of a node and its running, at which it gets a signal; by its own
processor time, as Python itself loses signals while it starts."""


class TestLifecycle(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.commands = rospy.Publisher("/joint_commands", JointState, queue_size=10)
        cls.states = Listener("/joint_states", JointState)
        wait_for(cls.commands.get_num_connections, "the bridge to listen")
        cls.early = ("left_elbow_joint", 0.625)
        cls.command(*cls.early)
        cls.launch = Launch("gazebo.launch", "respawn_gazebo:=true")
        cls.addClassCleanup(cls.launch.stop)

    @classmethod
    def command(cls, name, position):
        cls.states.clear()
        cls.commands.publish(JointState(name=[name], position=[position]))

    @staticmethod
    def set_speed(factor):
        rospy.ServiceProxy("/gazebo/set_real_time_factor", SetRealTimeFactor)(factor)

    def wait_for_joint(self, name, position):
        return self.states.wait(
            lambda m: abs(position_of(m, name) - position) < 1e-9,
            f"{name} at {position}",
        )

    def test_1_a_command_from_before_the_simulator_arrives(self):
        self.wait_for_joint(*self.early)

    def test_2_the_simulator_is_killed_and_comes_back(self):
        pid = wait_for(lambda: process_of("/gazebo"), "the simulator")
        os.kill(pid, signal.SIGKILL)
        self.command("left_elbow_joint", 0.375)
        new = wait_for(lambda: process_of("/gazebo") not in (None, pid), "a new one")
        self.assertTrue(new)
        message = self.wait_for_joint("left_elbow_joint", 0.375)
        self.assertEqual(len(message.name), 29)
        self.command("right_elbow_joint", 0.5)
        self.wait_for_joint("right_elbow_joint", 0.5)

    def test_3_reset_simulation_takes_time_and_joints_back(self):
        self.command("left_knee_joint", 1.0)
        last = self.wait_for_joint("left_knee_joint", 1.0).header.stamp
        wait_for(lambda: rospy.Time.now().to_sec() > 1.0, "a second")
        transforms = Listener("/tf", TFMessage)
        transforms.wait()
        # So slowly that a busy machine shows the first half of a second.
        self.set_speed(0.05)
        self.addCleanup(self.set_speed, 1.0)
        self.states.clear()
        transforms.clear()
        rospy.ServiceProxy("/gazebo/reset_simulation", Empty)()
        after = self.states.wait(lambda m: m.header.stamp < last, "an early stamp")
        self.assertLess(after.header.stamp.to_sec(), 0.5)
        self.wait_for_joint("left_knee_joint", 0.0)
        early = transforms.wait(
            lambda m: any(
                t.child_frame_id == "base_link" and t.header.stamp < last
                for t in m.transforms
            ),
            "base_link after the reset",
        )
        self.assertLess(early.transforms[0].header.stamp.to_sec(), 0.5)
        transforms.close()

    def test_4_reset_world_keeps_time_and_joints(self):
        self.command("left_knee_joint", 1.25)
        before = self.wait_for_joint("left_knee_joint", 1.25).header.stamp
        rospy.ServiceProxy("/gazebo/reset_world", Empty)()
        self.states.clear()
        after = self.wait_for_joint("left_knee_joint", 1.25).header.stamp
        self.assertGreater(after, before)

    def test_5_pause_is_silence_and_commands_still_count(self):
        states = Listener("/gazebo/link_states", LinkStates)
        clock = Listener("/clock", Clock)
        states.wait()
        rospy.ServiceProxy("/gazebo/pause_physics", Empty)()
        self.commands.publish(JointState(name=["left_knee_joint"], position=[0.25]))
        # Silence has no end to wait for: what is under way has arrived when two
        # round trips to the simulator are over.
        for _ in range(2):
            rospy.ServiceProxy("/gazebo/pause_physics", Empty)()
        wait_for(lambda: self.is_quiet(states, clock), "silence")
        rospy.ServiceProxy("/gazebo/unpause_physics", Empty)()
        self.states.clear()
        self.wait_for_joint("left_knee_joint", 0.25)
        states.close()
        clock.close()

    def is_quiet(self, *listeners):
        """Hold still for a fifth of a second of wall time without a message."""
        for listener in listeners:
            listener.clear()
        for listener in listeners:
            try:
                listener.wait(deadline=0.2)
            except AssertionError:
                continue
            return False
        return True

    def test_6_a_signal_is_heard_at_any_moment(self):
        """Also while the node starts, registers, and publishes to many."""
        command = [program("gazebo_stand_in.py"), "__name:=second"]
        for number in range(MOMENTS):
            kind = (signal.SIGINT, signal.SIGTERM)[number % 2]
            node = subprocess.Popen(
                [*command, "__ns:=/other", "/clock:=/other/clock"],
                stdout=subprocess.DEVNULL,
            )
            moment = 0.2 + 1.0 * number / MOMENTS
            wait_for(
                lambda node=node, moment=moment: (
                    node.poll() is not None or processor_time(node.pid) >= moment
                ),
                "the moment of the signal",
            )
            node.send_signal(kind)
            node.wait(DEADLINE)

    def test_6_a_node_says_that_another_one_took_its_name(self):
        command = [program("gazebo_stand_in.py"), "__name:=second"]
        command += ["__ns:=/other", "/clock:=/other/clock"]
        first = subprocess.Popen(command, stderr=subprocess.PIPE, text=True)
        self.addCleanup(first.kill)
        wait_for(lambda: process_of("/other/second") == first.pid, "the first")
        second = subprocess.Popen(command, stderr=subprocess.DEVNULL)
        self.addCleanup(second.kill)
        _, said = first.communicate(timeout=DEADLINE)
        self.assertIn("another node named /other/second has started", said)
        self.assertNotIn("Traceback", said)
        wait_for(lambda: process_of("/other/second") == second.pid, "the second")
        second.terminate()
        second.wait(DEADLINE)

    def test_6_a_new_simulator_tells_its_time_before_its_states(self):
        """robot_state_publisher complains of states 30 s older than its clock."""
        node = "/robot_state_publisher"
        log = NodeLog(node)
        self.addCleanup(log.close)
        self.set_speed(0.0)
        wait_for(lambda: rospy.Time.now().to_sec() > OLD, "an old clock")
        log.clear()
        pid = wait_for(lambda: process_of("/gazebo"), "the simulator")
        os.kill(pid, signal.SIGKILL)
        log.wait(
            lambda m: m.name == node and "Moved backwards in time" in m.msg,
            "the new time",
        )
        told = [m.msg for m in log.messages if m.name == node]
        self.assertFalse([line for line in told if "seconds old" in line], told)

    def test_7_an_interrupt_ends_the_simulator_at_once(self):
        pid = wait_for(lambda: process_of("/gazebo"), "the simulator")
        os.kill(pid, signal.SIGINT)
        wait_for(lambda: has_ended(pid), "its end")
        self.assertIn("/link_states_bridge", rosnode.get_node_names())
