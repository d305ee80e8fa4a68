"""Every joint gets its newest command, whatever becomes of the service meanwhile."""

import random
import sys
import threading
import time
import unittest

import rospy
from sensor_msgs.msg import JointState
from support.joint_limits import limits
from support.ros_testing import NodeLog, wait_for
from support.wire.raw_service import SUCCESS, Gate, Simulator, refusal

LOG_PERIOD = 10.0
"""A warning about the service comes once in so many seconds."""
SLOW = 0.3
"""[s]"""
MANY = 4000
RATE = 4000.0
"""Commands per second that are sent; tools/benchmark tells how many are taken."""
MODEL = "g1_robot"


class TestBridgeCommands(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.log = NodeLog("/link_states_bridge")
        cls.commands = rospy.Publisher("/joint_commands", JointState, queue_size=MANY)
        wait_for(cls.commands.get_num_connections, "the bridge to listen")
        cls.joints = limits()[0]

    def setUp(self):
        self.log.clear()
        self.random = random.Random(0)
        self.newest = {}

    def serve(self):
        """Be a simulator that begins with nothing."""
        self.simulator = Simulator()
        self.addCleanup(lambda simulator: simulator.close(), self.simulator)
        return self.simulator

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

    def wait_until_all_came(self):
        """Wait until the bridge has all commands: the last is bad, which it tells."""
        name = f"no_joint_{self.random.random()}"
        self.commands.publish(JointState(name=[name], position=[0.0]))
        self.log.wait(lambda m: name in m.msg, "the warning of the last command")

    def wait_for_newest(self):
        """Wait until every joint has the newest position."""

        def late():
            state = self.simulator.state.get(MODEL, {})
            joints = state.keys() | self.newest.keys()
            return {
                joint: (state.get(joint), self.newest.get(joint))
                for joint in joints
                if state.get(joint) != self.newest.get(joint)
            }

        try:
            wait_for(lambda: not late(), "every joint's newest command")
        except AssertionError as error:
            requests = len(self.simulator.requests)
            told = [m.msg for m in list(self.log.messages)]
            raise AssertionError(
                f"{error}: {requests} requests, late {late()}; log {told}"
            ) from None

    def warnings(self, words):
        return [m.msg for m in list(self.log.messages) if words in m.msg]

    def test_what_came_before_there_was_a_simulator_comes_in_one_call(self):
        begin = time.monotonic()
        self.stream(200, 1000.0)
        self.log.wait(
            lambda m: "Cannot send a command" in m.msg, "a line about the service"
        )
        self.wait_until_all_came()
        self.serve()
        self.wait_for_newest()
        self.assertEqual(len(self.simulator.requests), 1)
        told = len(self.warnings("Cannot send a command"))
        self.assertLessEqual(told, 1 + (time.monotonic() - begin) / LOG_PERIOD)

    def test_a_slow_simulator_gets_the_newest_in_few_calls(self):
        pause = threading.Event()

        def answer(model):
            pause.wait(SLOW)
            return SUCCESS

        self.serve().answers = answer
        begin = time.monotonic()
        self.stream(500, 500.0)
        self.wait_for_newest()
        elapsed = time.monotonic() - begin
        self.assertLess(len(self.simulator.requests), elapsed / SLOW + 2)
        self.assert_nothing_goes_back()

    def assert_nothing_goes_back(self):
        """Positions only grew, so an older one after a newer one would be smaller."""
        last = {}
        for _, positions in self.simulator.requests:
            for joint, position in positions.items():
                self.assertGreaterEqual(position, last.get(joint, 0.0), joint)
            last.update(positions)

    def test_a_simulator_that_hangs_has_every_joint_when_it_goes_on(self):
        gate = self.serve().answers = Gate()
        self.addCleanup(gate.open)
        self.command(left_knee_joint=0.5)
        self.simulator.wait_for_request(left_knee_joint=0.5)
        wait_for(
            lambda: (
                self.stream(200, 1000.0) or self.warnings("has not answered a command")
            ),
            "a line about the answer",
        )
        self.stream(200, 1000.0)
        self.wait_until_all_came()
        self.assertEqual(len(self.simulator.requests), 1)
        gate.open()
        self.wait_for_newest()
        self.assertEqual(len(self.simulator.requests), 2)

    def test_a_refusal_is_told_and_what_comes_after_it_counts(self):
        begin = time.monotonic()
        self.serve().answers = lambda model: refusal("not today")
        self.command(left_knee_joint=0.75)
        told = self.log.wait(lambda m: "not today" in m.msg, "the reason")
        self.assertIn("left_knee_joint", told.msg)
        for number in range(50):
            self.command(left_knee_joint=0.001 * number)
        self.simulator.wait_for_request(left_knee_joint=0.049)
        self.simulator.answers = lambda model: SUCCESS
        self.command(left_knee_joint=0.875)
        self.wait_for_newest()
        # One at once, then one a second.
        self.assertLess(len(self.warnings("not today")), 3 + time.monotonic() - begin)

    def test_a_simulator_that_dies_during_a_call_is_called_again(self):
        gate = self.serve().answers = Gate()
        self.addCleanup(gate.open)
        self.command(left_knee_joint=0.625)
        self.simulator.wait_for_request(left_knee_joint=0.625)
        self.command(left_elbow_joint=0.25)
        self.simulator.close()
        gate.open()
        # Nobody is there for a while.
        self.stream(100, 1000.0)
        self.wait_until_all_came()
        self.serve()
        self.wait_for_newest()

    def test_a_connection_reset_during_a_call_loses_nothing(self):
        self.serve()
        for number in range(2):
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

    def test_of_thousands_a_second_every_joint_has_its_newest(self):
        self.serve()
        begin = time.monotonic()
        self.stream(MANY, RATE)
        self.wait_for_newest()
        elapsed = time.monotonic() - begin
        print(
            f"bridge_commands: {MANY / elapsed:.0f} commands/s in "
            f"{len(self.simulator.requests)} calls",
            file=sys.stderr,
        )
        self.assertEqual(set(self.newest), set(self.joints))
        self.assert_nothing_goes_back()
