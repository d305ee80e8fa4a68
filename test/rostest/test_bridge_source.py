"""States without stamps get the newest time of /clock, each time one."""

import time
import unittest

import rospy
from rosgraph_msgs.msg import Clock
from support.bridge.arm import URDF, arm_states, shows
from support.bridge.watched import Watched
from support.ros_testing import Repeated, wait_for

from tcpros import body_of

MANY = 500
"""Messages under one time: far more than a busy machine is held up between."""


class TestBridgeSource(unittest.TestCase):
    names = 0

    @classmethod
    def setUpClass(cls):
        rospy.set_param("/robot_description", URDF)
        rospy.set_param("/use_sim_time", True)
        cls.addClassCleanup(rospy.set_param, "/use_sim_time", False)
        cls.clock = rospy.Publisher("/clock", Clock, queue_size=100)
        cls.time = rospy.Duration(100.0)

    def start(self, *arguments):
        TestBridgeSource.names += 1
        self.addCleanup(Repeated(lambda: self.tick(0.0), 0.005).close)
        self.watched = Watched(f"/source_{self.names}", *arguments)
        self.addCleanup(self.watched.bridge.kill)
        self.addCleanup(self.watched.close)

    def tick(self, seconds):
        """Let the clock go on."""
        TestBridgeSource.time += rospy.Duration(seconds)
        self.clock.publish(Clock(rospy.Time() + self.time))

    def settle(self, shoulder):
        """Send a state, and wait until it shows, even under the stamp before."""
        positions = {"shoulder": shoulder, "elbow": 0.0, "slide": 0.0}
        self.watched.send(body_of(arm_states(shoulder)))
        return self.watched.states.wait(lambda m: shows(m, positions), "it")

    def stamps(self):
        return [m.header.stamp.to_nsec() for m in list(self.watched.states.messages)]

    def test_1_of_many_under_one_time_two_come_and_each_time_has_its_state(self):
        self.start()
        self.settle(0.5)
        self.watched.states.clear()
        self.watched.send(body_of(arm_states(0.6)), MANY)
        last = self.settle(0.7)
        stamps = self.stamps()
        self.assertEqual(stamps, sorted(set(stamps)))
        # Where the machine is held up, what is last for a while comes as well.
        self.assertLess(len(stamps), MANY / 2)
        now = rospy.Time() + self.time
        self.assertLess(abs((last.header.stamp - now).to_nsec()), 1000)

        self.watched.states.clear()
        for number in range(1, 21):
            self.tick(0.002)
            now = rospy.Time() + self.time
            positions = {"shoulder": 0.01 * number, "elbow": 0.0, "slide": 0.0}

            message = body_of(arm_states(0.01 * number))

            def has_come(positions=positions, message=message):
                self.watched.send(message)
                found = list(self.watched.states.messages)
                return found and shows(found[-1], positions)

            wait_for(has_come, "it")
            last = self.watched.states.messages[-1].header.stamp
            self.assertLessEqual(last.to_nsec() - now.to_nsec(), 1000)
        stamps = self.stamps()
        self.assertEqual(stamps, sorted(set(stamps)))

    def test_2_a_rate_thins_them_and_the_last_still_comes(self):
        self.start("_max_rate:=10.0")
        self.settle(0.1)
        self.watched.states.clear()
        begin = time.monotonic()
        for number in range(250):
            self.tick(0.004)
            self.watched.send(body_of(arm_states(0.001 * number)))
            rospy.rostime.wallsleep(0.001)
        self.settle(0.9)
        stamps = self.stamps()
        # Ten in a second of the clock; where that is slow, ten of the wall's.
        most = 3.0 + 10.0 * max(1.0, time.monotonic() - begin)
        self.assertTrue(2 <= len(stamps) <= most, (len(stamps), most))
        self.assertEqual(stamps, sorted(set(stamps)))
