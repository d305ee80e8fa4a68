"""Nothing that comes as link states hurts the bridge, and all of it is told once."""

import time
import unittest

import rospy
from gazebo_msgs.msg import LinkStates
from rosgraph_msgs.msg import Log
from sensor_msgs.msg import JointState
from support.bridge.arm import JOINTS, URDF, arm_states, shows
from support.bridge.hostile_cases import KINDS, SILENCE, cases
from support.bridge.watched import Watched
from support.ros_testing import Listener, wait_for
from support.wire.raw_publisher import RawPublisher
from support.wire.raw_subscriber import RawSubscriber
from tf2_msgs.msg import TFMessage

from tcpros import LENGTH, body_of

TIMES = 20
"""How often each message comes."""
PILE = 2500
STEPS = 100
APART = 5.0
"""Least time between two lines of one kind in [s]: half the time for which they are
counted, as a line is stamped some time after it was found to be due."""


class TestBridgeHostile(unittest.TestCase):
    count = 0

    @classmethod
    def setUpClass(cls):
        """Start a bridge that gets the worst, and one that is never told of a fault.

        The time is the wall's, so that each message has one of its own.
        """
        rospy.set_param("/robot_description", URDF)
        cls.troubled, cls.quiet = (cls.watch(name) for name in ("troubled", "quiet"))

    @classmethod
    def watch(cls, name):
        """Start a bridge."""
        watched = Watched(f"/{name}", has_clock=False)
        cls.addClassCleanup(watched.bridge.kill)
        cls.addClassCleanup(watched.close)
        return watched

    def check(self, watched):
        """Show the robot in a new position; it must be the same process that tells."""
        TestBridgeHostile.count += 1
        positions = [self.count * 1e-4, self.count * -2e-4, self.count * 3e-5]
        watched.show(arm_states(*positions), dict(zip(JOINTS, positions)))
        self.assertTrue(watched.bridge.is_alive(), watched.bridge.output())
        self.assertEqual(watched.bridge.trouble(), [])

    def kinds_told(self, watched):
        """Give the kinds of the lines so far.

        On a busy machine there may be one of silence as well, between two messages.
        """
        lines = watched.warnings()
        return {k for k in KINDS if any(k in line for line in lines)} - {SILENCE}

    def check_log(self, watched):
        """Read the lines, and when they came, by kind."""
        stamps = {}
        for message in list(watched.log.messages):
            if message.name != watched.bridge.name or message.level < Log.WARN:
                continue
            kinds = [kind for kind in KINDS if kind in message.msg]
            self.assertEqual(len(kinds), 1, message.msg)
            stamps.setdefault(kinds[0], []).append(message.header.stamp.to_sec())
        for kind, times in stamps.items():
            for one, other in zip(times, times[1:]):
                self.assertGreater(other - one, APART, kind)
        return stamps

    def test_1_every_kind_of_fault_is_told_at_once_and_in_one_line(self):
        watched = self.troubled
        for name, case in cases().items():
            with self.subTest(name):
                self.feed(watched, case)
        watched.wait_for_log()
        self.check_log(watched)

    def feed(self, watched, case):
        """Send a message some times, and look at what comes of it."""
        kinds = self.kinds_told(watched) | ({case.told} - {None})
        watched.states.clear()
        watched.send(case.data, TIMES)
        self.check(watched)
        shown = list(watched.states.messages)[:-1]
        # A bridge that was held up takes the newest of them.
        most = 0 if case.shown is None else TIMES
        self.assertTrue(bool(most) <= len(shown) <= most, len(shown))
        for message in shown:
            self.assertTrue(shows(message, case.shown), message)
        wait_for(lambda: self.kinds_told(watched) >= kinds, f"a line: {case.told}")
        self.assertEqual(self.kinds_told(watched), kinds)

    def another(self, watched, name, **options):
        """Let another node publish beside the good one."""
        publisher = RawPublisher(
            watched.topic, LinkStates, f"{watched.namespace}/{name}", **options
        )
        publisher.wait_for_subscriber()
        return publisher

    def test_2_a_publisher_that_dies_in_the_middle_of_a_message(self):
        watched = self.quiet
        data = body_of(arm_states())
        for cut in (2, 4, 200):
            dying = self.another(watched, f"dying_{cut}")
            dying.send_raw((LENGTH.pack(len(data)) + data)[:cut])
            dying.die()
            self.check(watched)
        watched.publisher.die()
        watched.publisher = self.another(watched, "next")
        self.check(watched)
        self.assertEqual(self.kinds_told(watched), set())

    def test_2_publishers_that_say_nothing_or_never_end_beside_a_good_one(self):
        watched = self.quiet
        mute = self.another(watched, "mute", answers=False)
        self.addCleanup(mute.close)
        self.check(watched)
        idle = self.another(watched, "idle")
        self.addCleanup(idle.close)
        self.check(watched)
        endless = self.another(watched, "endless")
        self.addCleanup(endless.close)
        endless.send_raw(LENGTH.pack(2**32 - 1) + bytes(100_000))
        self.check(watched)
        self.assertEqual(self.kinds_told(watched), set())

    def test_2_one_wrong_speed_does_not_turn_a_wheel_for_ever(self):
        """The shoulder has no limits: its turns are counted from one message on."""
        watched = self.quiet
        for number in range(10):
            glitch = arm_states()
            for twist in glitch.twist[2:]:
                twist.angular.z = 1e5 + number * 2e4
            watched.send(body_of(glitch))
            self.check(watched)

    def test_2_who_was_held_up_takes_the_newest_and_not_all_that_came(self):
        watched = self.quiet
        watched.bridge.stop()
        self.addCleanup(watched.bridge.go_on)
        data = body_of(arm_states())
        watched.send(data, times=PILE)
        watched.states.clear()
        watched.bridge.go_on()
        self.check(watched)
        # What is handed on piecemeal, on a busy machine, looks less like a pile.
        self.assertLess(len(watched.states.messages), PILE)

    def test_2_who_waits_for_each_answer_gets_each(self):
        """A simulator that steps when a controller has seen the last step."""
        watched = self.quiet
        topic = watched.states.topic
        reader = RawSubscriber(watched.bridge.uri, topic, JointState)
        self.addCleanup(reader.close)
        data = body_of(arm_states())
        wait_for(lambda: watched.send(data) or reader.has_data(0.02), "joint states")
        self.check(watched)
        reader.read_all()
        for _ in range(STEPS):
            watched.send(data)
            reader.read()

    def test_2_stamps_are_those_of_the_wall(self):
        watched = self.quiet
        frames = Listener("/tf", TFMessage)
        self.addCleanup(frames.close)
        for number in range(20):
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
