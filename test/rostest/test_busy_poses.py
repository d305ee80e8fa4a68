"""The command pose where all cores are busy and joint states come faster than read.

tools/benchmark --only poses does it a hundred times.
"""

import subprocess
import threading
import unittest

import rospy
from sensor_msgs.msg import JointState
from support.burners import Burners
from support.ros_testing import DEADLINE, Connected, wait_for
from support.wire.raw_publisher import RawPublisher

from g1_description.ros.waiting import NEWEST

from tcpros import body_of

CALLS = (
    ("squat",),
    ("wave", "--seconds", "0.5"),
)
MANY = 1000
"""Joint states that wait to be read, 1.4 MB of them."""


def pose(*words):
    return subprocess.Popen(
        ["rosrun", "g1_description", "pose", *words],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )


class TestBusyPoses(unittest.TestCase):
    def test_no_call_gives_up(self):
        self.addCleanup(Burners().close)
        Connected("/joint_states", JointState).close()
        for words in CALLS:
            output, _ = pose(*words).communicate(timeout=DEADLINE)
            self.assertEqual(output.splitlines()[-1:], [f"pose: {words[0]}"], output)

    def test_who_wants_the_newest_passes_over_what_waits(self):
        """A reader that is held up while many come reads few of them, and the last."""
        publisher = RawPublisher("/many/joint_states", JointState, "/many")
        self.addCleanup(publisher.close)
        gate, taken = threading.Event(), []

        def take(message):
            gate.wait(2 * DEADLINE)
            taken.append(message.header.seq)

        subscriber = rospy.Subscriber(publisher.topic, JointState, take, **NEWEST)
        self.addCleanup(subscriber.unregister)
        publisher.wait_for_subscriber()
        message = JointState(name=["a" * 1000], position=[0.0] * 45)

        def send():
            for number in range(MANY):
                message.header.seq = number
                publisher.send(body_of(message))

        sender = threading.Thread(target=send, daemon=True)
        sender.start()
        sender.join(60.0)  # or until the system's buffers are full
        gate.set()
        wait_for(lambda: taken[-1:] == [MANY - 1], "the last message")
        self.assertLess(len(taken), MANY / 5)
