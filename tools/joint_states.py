#!/usr/bin/python3
"""Wait for joint states and print what flows, as one line of JSON."""

import argparse
import json
import time

import rospy
from sensor_msgs.msg import JointState


class Counter:
    """Counts messages and keeps the names of the last one."""

    def __init__(self):
        """Start at none."""
        self.count = 0
        self.names = []

    def __call__(self, message):
        """Take one message."""
        self.count += 1
        self.names = message.name


def wait_for(condition, deadline):
    """Wait on the wall clock; simulated time may stand still.

    Args:
        condition: Function of nothing, true when the wait is over.
        deadline: Time on the monotonic clock when the timeout ends, in [s].

    Raises:
        SystemExit: If the condition was not true in time.
    """
    while not condition():
        if time.monotonic() > deadline or rospy.is_shutdown():
            raise SystemExit("no message on /joint_states in time")
        time.sleep(0.01)


def main():
    """Measure once and end."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--timeout", type=float, default=60.0, help="[s]")
    parser.add_argument("--seconds", type=float, default=1.0, help="to measure [s]")
    arguments = parser.parse_args()

    rospy.init_node("joint_states_meter", anonymous=True)
    counter = Counter()
    # All of them count.
    rospy.Subscriber(
        "/joint_states", JointState, counter, queue_size=None, tcp_nodelay=True
    )
    wait_for(lambda: counter.count, time.monotonic() + arguments.timeout)

    start, first = time.monotonic(), counter.count
    time.sleep(arguments.seconds)
    rate = (counter.count - first) / (time.monotonic() - start)
    print(json.dumps({"names": counter.names, "rate": rate}))


if __name__ == "__main__":
    main()
