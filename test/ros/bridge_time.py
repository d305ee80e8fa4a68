#!/usr/bin/env python3
"""Stamps are honest, and never repeated on /tf, whatever happens to the time."""

import os
import re
import signal
import struct
import subprocess
import sys
import tempfile
import time
import unittest

import rosgraph
import rospy
import rostest
from bridge_arm import URDF, arm_states
from bridge_watch import Watched
from burners import Burners
from fuzz_wire import body_of
from gazebo_msgs.msg import ModelState
from geometry_msgs.msg import TransformStamped
from ros_testing import Launch, Listener, Repeated, process_of, wait_for
from rosgraph_msgs.msg import Log
from sensor_msgs.msg import JointState
from std_srvs.srv import Empty
from tf2_msgs.msg import TFMessage

SEQ_AND_STAMP = struct.Struct("<III")
SECOND = 1_000_000_000
"""[ns]"""
JUMP = SECOND // 2
"""Stamps that go back by more than this, in [ns], tell that the time did."""
AT_ONCE = 1.0
"""Longest time to the first states after a jump in [s] of wall time."""
TROUBLE = re.compile(r"TF_(?:REPEATED|OLD)_DATA .* for frame (\S+) at time ([\d.]+)")
BASE = "base_link"
"""The frame that the bridge itself moves."""
LISTENER = """
import rospy, tf2_ros
rospy.init_node("listener", anonymous=True)
listener = tf2_ros.TransformListener(tf2_ros.Buffer())
rospy.spin()
"""
LISTENERS = (
    ["rosrun", "tf", "tf_echo", "map", "pelvis"],
    ["rosrun", "tf", "tf_monitor"],
    [sys.executable, "-c", LISTENER],
)
"""Programs that listen to TF with its C++ core, each in its own way."""


def subscribers(topic):
    """Count who listens to a topic."""
    _, subscribed, _ = rosgraph.Master("/test").getSystemState()
    return len(dict(subscribed).get(topic, ()))


def splits(stamps):
    """Split stamps where the time went back."""
    lives = [stamps[:1]]
    for one, other in zip(stamps, stamps[1:]):
        if other < one - JUMP:
            lives.append([])
        lives[-1].append(other)
    return lives


class Others:
    """Nodes that know nothing of the bridge, and what they print about TF."""

    def __init__(self, topic="/tf"):
        already = subscribers(topic)
        self._outputs = [tempfile.TemporaryFile() for _ in LISTENERS]  # noqa: SIM115
        self._processes = [
            subprocess.Popen(
                [*command, f"/tf:={topic}"], stdout=output, stderr=subprocess.STDOUT
            )
            for command, output in zip(LISTENERS, self._outputs)
        ]
        wait_for(
            lambda: subscribers(topic) == already + len(LISTENERS),
            f"those who listen to {topic}",
        )

    def trouble(self):
        """List the frames and stamps that each complains of."""
        return [self._trouble(output.fileno()) for output in self._outputs]

    @staticmethod
    def _trouble(descriptor):
        data = os.pread(descriptor, os.fstat(descriptor).st_size, 0)
        return TROUBLE.findall(data.decode("utf-8", "replace"))

    def close(self):
        for process in self._processes:
            process.send_signal(signal.SIGINT)
        for process in self._processes:
            process.wait(10.0)


class Record:
    """The stamps in [ns] of all that came."""

    def __init__(self):
        self._joints = Listener("/joint_states", rospy.AnyMsg)
        self._frames = Listener("/tf", TFMessage)
        self._log = Listener("/rosout", Log)
        self._listeners = self._joints, self._frames, self._log

    def joints(self):
        """Give the stamps of joint states."""
        parts = (
            SEQ_AND_STAMP.unpack_from(m._buff) for m in list(self._joints.messages)
        )
        return [seconds * SECOND + rest for _, seconds, rest in parts]

    def frames(self):
        """Give the stamps of each child frame."""
        found = {}
        for message in list(self._frames.messages):
            for transform in message.transforms:
                stamps = found.setdefault(transform.child_frame_id, [])
                stamps.append(transform.header.stamp.to_nsec())
        return found

    def trouble(self):
        """List the frames and stamps that the log complains of."""
        lines = [message.msg for message in list(self._log.messages)]
        return TROUBLE.findall("\n".join(lines))

    def clear(self):
        for listener in self._listeners:
            listener.clear()

    def close(self):
        for listener in self._listeners:
            listener.close()


class TestBridgeTime(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.seconds = rospy.get_param("~seconds")
        cls.commands = rospy.Publisher("/joint_commands", JointState, queue_size=1)
        cls.model = rospy.Publisher("/gazebo/set_model_state", ModelState, queue_size=1)
        cls.steps = 0

    def start(self, *arguments):
        """Launch the display on a busy machine, let the robot dance, and listen."""
        self.addCleanup(Burners().close)
        launch = Launch("display.launch", "rviz:=false", *arguments)
        self.addCleanup(launch.stop)
        self.record = Record()
        self.addCleanup(self.record.close)
        wait_for(self.record.joints, "joint states")
        wait_for(lambda: len(self.record.frames()) == 30, "the frames of all links")
        self.addCleanup(Repeated(self.dance, 0.01).close)
        self.others = Others()
        self.addCleanup(self.others.close)
        self.record.clear()

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
        """Let a share of the whole time pass."""
        end = time.monotonic() + share * self.seconds
        wait_for(lambda: time.monotonic() > end, "the time", 2.0 * self.seconds)

    def jump(self, act, deadline=AT_ONCE):
        """Let the time go back; states and base must come again at once."""
        before = len(splits(self.record.joints()))
        act()

        def have_jumped():
            both = self.record.joints(), self.record.frames()[BASE]
            return all(len(splits(stamps)) == before + 1 for stamps in both)

        wait_for(have_jumped, "joint states and base after the jump", deadline)

    def check_stamps(self, jumps):
        """No stamp comes twice on /tf, and the base comes with the first states."""
        joints = splits(self.record.joints())
        frames = self.record.frames()
        bases = splits(frames.pop(BASE))
        self.assertEqual((len(joints), len(bases)), (jumps + 1, jumps + 1))
        for stamps in joints:
            self.assertEqual(stamps, sorted(set(stamps)))
        for stamps in bases:
            self.assertEqual(stamps, sorted(set(stamps)))
        for life, base in zip(joints[1:], bases[1:]):
            self.assertIn(base[0], life[:2])
        for frame, stamps in frames.items():
            for life in splits(stamps):
                self.assertEqual(life, sorted(set(life)), frame)

    def check_silence(self):
        """Nobody who listens to TF complains."""
        for trouble in (*self.others.trouble(), self.record.trouble()):
            self.assertEqual(trouble, [])

    def test_1_those_who_listen_tell_when_a_stamp_comes_twice(self):
        """Else their silence would tell nothing."""
        others = Others("/repeated")
        self.addCleanup(others.close)
        publisher = rospy.Publisher("/repeated", TFMessage, queue_size=1)
        self.addCleanup(publisher.unregister)
        edge = TransformStamped(child_frame_id="pelvis")
        edge.header.frame_id, edge.header.stamp = "map", rospy.Time.now()
        edge.transform.rotation.w = 1.0
        wait_for(
            lambda: publisher.publish(TFMessage([edge])) or all(others.trouble()),
            "all to complain",
        )

    def test_2_resets_a_pause_and_a_new_simulator(self):
        self.start("respawn_gazebo:=true")
        # Beyond the ten seconds that TF remembers, older data could be refused.
        self.run_for(0.55)
        for _ in range(2):
            self.jump(rospy.ServiceProxy("/gazebo/reset_simulation", Empty))
            self.run_for(0.1)
        rospy.ServiceProxy("/gazebo/pause_physics", Empty)()
        self.run_for(0.05)
        rospy.ServiceProxy("/gazebo/unpause_physics", Empty)()
        self.run_for(0.05)
        self.check_stamps(jumps=2)
        # Whoever has not heard the new simulator's clock takes its time for the old.
        self.check_silence()
        pid = process_of("/gazebo")
        self.jump(lambda: os.kill(pid, signal.SIGKILL), 20.0)
        self.run_for(0.1)
        self.check_stamps(jumps=3)

    def test_4_the_time_of_the_wall(self):
        self.start("use_sim_time:=false")
        self.run_for(0.15)
        stamps = self.record.joints()
        self.assertAlmostEqual(stamps[-1] / SECOND, time.time(), delta=1.0)
        self.assertEqual(stamps, sorted(set(stamps)))
        self.check_stamps(jumps=0)
        self.check_silence()

    def test_5_the_time_of_the_wall_without_any_clock(self):
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
        last = wait_for(
            lambda: watched.send(body_of(arm_states())) or frames.messages, "base_link"
        )[-1].transforms[0]
        self.assertEqual(last.child_frame_id, "base_link")
        self.assertAlmostEqual(last.header.stamp.to_sec(), time.time(), delta=1.0)


if __name__ == "__main__":
    rospy.init_node("bridge_time_test")
    rostest.rosrun("g1_description", "bridge_time", TestBridgeTime, sys.argv)
