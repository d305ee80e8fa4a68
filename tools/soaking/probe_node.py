#!/usr/bin/env python3
"""A node that reads, commands and resets as users do, and tells what came of it.

Arguments: time between two commands, between two resets, between two lines, in [s].
Prints a line of JSON for each sample: rates and counts since the one before.
"""

import json
import re
import sys
import threading
import time
from collections import Counter

import rospy
from rosgraph_msgs.msg import Log
from sensor_msgs.msg import JointState
from std_srvs.srv import Empty

from g1_description.ros.lifecycle import start_node
from g1_description.ros.master import stay_registered

TOPICS = ("/joint_states", "/tf", "/clock")
JOINT = "left_wrist_roll_joint"
"""Commanded here; the motion that is played leaves it alone."""
POSITIONS = (0.25, -0.25, 0.5, -0.5)
LONGEST = 20.0
"""Time in [s] after which a command that did not arrive is lost."""
TOLERANCE = 1e-6
NUMBER = re.compile(r"[-\d.]+")


class Probe:
    """Counts what comes, and sends commands."""

    def __init__(self):
        """Connect to all topics."""
        self.counts, self.kinds = Counter(), Counter()
        self.latencies, self.lost = [], []
        self.begin = time.monotonic()
        self._wanted, self._arrived = None, threading.Event()
        for topic in TOPICS:
            rospy.Subscriber(topic, rospy.AnyMsg, self._came, callback_args=topic)
        rospy.Subscriber("/rosout", Log, self._logged)
        self._commands = rospy.Publisher("/joint_commands", JointState, queue_size=10)

    def _came(self, message, topic):
        self.counts[topic] += 1
        wanted = self._wanted
        if topic == "/joint_states" and wanted is not None:
            state = JointState().deserialize(message._buff)
            now = dict(zip(state.name, state.position)).get(JOINT)
            if now is not None and abs(now - wanted) < TOLERANCE:
                self._arrived.set()

    def _logged(self, line):
        if line.level >= Log.WARN:
            text = NUMBER.sub("N", line.msg.splitlines()[0] if line.msg else "")
            self.kinds[f"{line.name}: {text[:150]}"] += 1

    def command(self, position):
        """Move the joint; wait until joint states show it."""
        self._arrived.clear()
        self._wanted = position
        begin = time.monotonic()
        self._commands.publish(JointState(name=[JOINT], position=[position]))
        if self._arrived.wait(LONGEST):
            self.latencies.append(time.monotonic() - begin)
        else:
            self.lost.append(begin)
        self._wanted = None

    def reset(self):
        """Let simulated time and the robot begin again."""
        try:
            rospy.ServiceProxy("/gazebo/reset_simulation", Empty)()
            self.counts["resets"] += 1
        except (rospy.ServiceException, rospy.ROSException, OSError):
            self.counts["resets refused"] += 1

    def tell(self):
        """Print what there was since the last line."""
        now = time.monotonic()
        told = {
            "time": now,
            "seconds": now - self.begin,
            "counts": dict(self.counts),
            "latencies": self.latencies,
            "lost": self.lost,
            "kinds": dict(self.kinds),
        }
        self.begin = now
        self.counts, self.kinds = Counter(), Counter()
        self.latencies, self.lost = [], []
        print(json.dumps(told), flush=True)


def main():
    """Command and reset until somebody ends it."""
    command_period, reset_period, sample_period = map(float, sys.argv[1:4])
    start_node("soak_probe")
    probe = Probe()
    stay_registered()
    stopped = threading.Event()
    rospy.on_shutdown(stopped.set)

    def sample():
        while not stopped.wait(sample_period):
            probe.tell()

    threading.Thread(target=sample, daemon=True).start()
    number, reset_at = 0, time.monotonic() + reset_period
    while not stopped.wait(command_period):
        # A command in flight when the simulator is reset would be undone.
        if time.monotonic() >= reset_at:
            probe.reset()
            reset_at += reset_period
        probe.command(POSITIONS[number % len(POSITIONS)])
        number += 1


if __name__ == "__main__":
    main()
