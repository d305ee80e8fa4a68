#!/usr/bin/env python3
"""Every joint gets its newest command, whatever becomes of the service meanwhile."""

import random
import sys
import threading
import time
import unittest

import rospy
import rostest
from rosgraph_msgs.msg import Log
from sensor_msgs.msg import JointState
from support.joint_limits import limits
from support.ros_testing import Listener, wait_for
from support.wire.raw_service import SUCCESS, Gate, Simulator, refusal

HANG = 10.0
"""[s]"""
SLOW = 0.3
"""[s]"""
MANY = 8000
RATE = 4000.0
"""Commands per second that are sent."""
LEAST = 1000.0
"""Commands per second that must be taken."""
MODEL = "g1_robot"


class TestBridgeCommands(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.log = Listener("/rosout", Log)
        cls.commands = rospy.Publisher("/joint_commands", JointState, queue_size=MANY)
        wait_for(cls.commands.get_num_connections, "the bridge to listen")
        cls.joints = limits()[0]
        cls.random = random.Random(0)
        cls.newest = {}
        cls.simulator = None

    def setUp(self):
        self.log.clear()
        if self.simulator is not None:
            self.simulator.answers = lambda model: SUCCESS

    def command(self, **positions):
        self.newest.update(positions)
        self.commands.publish(
            JointState(name=[*positions], position=[*positions.values()])
        )

    def stream(self, count, rate):
        """Send commands for a few joints each, whose positions only grow."""
        begin = time.monotonic()
        for number in range(count):
            due = begin + number / rate
            wait_for(lambda due=due: time.monotonic() >= due, "the time to send")
            joints = self.random.sample(self.joints, self.random.randint(1, 5))
            self.command(**dict.fromkeys(joints, number * 1e-4))

    def wait_for_newest(self):
        """Wait until every joint has the newest position."""
        wait_for(
            lambda: self.simulator.state.get(MODEL) == self.newest,
            "every joint's newest command",
        )

    def warnings(self, words):
        return [m.msg for m in list(self.log.messages) if words in m.msg]

    def test_1_what_came_before_there_was_a_simulator_comes_in_one_call(self):
        self.stream(200, 1000.0)
        self.log.wait(
            lambda m: "waits for the simulator" in m.msg, "a line about the service"
        )
        TestBridgeCommands.simulator = Simulator()
        self.wait_for_newest()
        self.assertEqual(len(self.simulator.requests), 1)
        self.assertEqual(len(self.warnings("waits for the simulator")), 1)

    def test_2_a_slow_simulator_gets_the_newest_in_few_calls(self):
        pause = threading.Event()

        def answer(model):
            pause.wait(SLOW)
            return SUCCESS

        self.simulator.answers = answer
        self.simulator.requests.clear()
        begin = time.monotonic()
        self.stream(1000, 500.0)
        self.wait_for_newest()
        elapsed = time.monotonic() - begin
        self.assertLess(len(self.simulator.requests), elapsed / SLOW + 2)
        self.assertLess(elapsed, 1000 / 500.0 + 3 * SLOW + 1.0)
        self.assert_nothing_goes_back()

    def assert_nothing_goes_back(self):
        """Positions only grew, so an older one after a newer one would be smaller."""
        last = {}
        for _, positions in self.simulator.requests:
            for joint, position in positions.items():
                self.assertGreaterEqual(position, last.get(joint, 0.0), joint)
            last.update(positions)

    def test_3_a_simulator_that_hangs_has_every_joint_when_it_goes_on(self):
        gate = self.simulator.answers = Gate()
        self.simulator.requests.clear()
        begin = time.monotonic()
        self.command(left_knee_joint=0.5)
        self.simulator.wait_for_request(left_knee_joint=0.5)
        while time.monotonic() < begin + HANG:
            self.stream(200, 1000.0)
        self.assertEqual(len(self.simulator.requests), 1)
        self.assertIn(len(self.warnings("waits for the simulator's answer")), (1, 2))
        gate.open()
        self.wait_for_newest()
        self.assertEqual(len(self.simulator.requests), 2)

    def test_4_a_refusal_is_told_and_what_comes_after_it_counts(self):
        self.simulator.answers = lambda model: refusal("not today")
        self.command(left_knee_joint=0.75)
        told = self.log.wait(lambda m: "not today" in m.msg, "the reason")
        self.assertIn("left_knee_joint", told.msg)
        for number in range(50):
            self.command(left_knee_joint=0.001 * number)
        self.simulator.wait_for_request(left_knee_joint=0.049)
        self.simulator.answers = lambda model: SUCCESS
        self.command(left_knee_joint=0.875)
        self.wait_for_newest()
        self.assertLess(len(self.warnings("not today")), 4)

    def test_5_a_simulator_that_dies_during_a_call_is_called_again(self):
        gate = self.simulator.answers = Gate()
        self.command(left_knee_joint=0.625)
        self.simulator.wait_for_request(left_knee_joint=0.625)
        self.command(left_elbow_joint=0.25)
        had = dict(self.simulator.state[MODEL])
        self.simulator.close()
        gate.open()
        # Nobody is there for a while.
        self.stream(100, 1000.0)
        self.log.wait(
            lambda m: "waits for the simulator" in m.msg, "a line about the service"
        )
        TestBridgeCommands.simulator = Simulator()
        self.simulator.state[MODEL] = had
        self.wait_for_newest()

    def test_6_a_connection_reset_during_a_call_loses_nothing(self):
        for number in range(5):
            gate = self.simulator.answers = Gate()
            self.simulator.requests.clear()
            self.command(left_knee_joint=0.3 + number)
            self.simulator.wait_for_request(left_knee_joint=0.3 + number)
            self.command(right_knee_joint=0.1 + number)
            self.simulator.reset()
            self.simulator.answers = lambda model: SUCCESS
            gate.open()
            self.wait_for_newest()
        self.assertEqual(len(self.warnings("Traceback")), 0)

    def test_7_of_thousands_a_second_every_joint_has_its_newest(self):
        self.simulator.requests.clear()
        begin = time.monotonic()
        self.stream(MANY, RATE)
        self.wait_for_newest()
        elapsed = time.monotonic() - begin
        print(
            f"bridge_commands: {MANY / elapsed:.0f} commands/s in "
            f"{len(self.simulator.requests)} calls",
            file=sys.stderr,
        )
        self.assertGreater(MANY / elapsed, LEAST)
        self.assertEqual(set(self.newest), set(self.joints))
        self.assert_nothing_goes_back()


if __name__ == "__main__":
    rospy.init_node("bridge_commands_test")
    rostest.rosrun("g1_description", "bridge_commands", TestBridgeCommands, sys.argv)
