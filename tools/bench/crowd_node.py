"""Count the joint states of many robots: crowd_node.py COUNT SECONDS.

Prints "begin" once all robots are measured, then the rate of each in [Hz].
"""

import sys
import time
from functools import partial

import rospy


def main():
    """Count."""
    counts, seconds = [0] * int(sys.argv[1]), float(sys.argv[2])
    rospy.init_node("crowd")

    def count(number, _):
        counts[number] += 1

    for number in range(len(counts)):
        topic = f"/robot_{number}/joint_states"
        rospy.Subscriber(topic, rospy.AnyMsg, partial(count, number), tcp_nodelay=True)
    while not all(counts):
        time.sleep(0.1)
    print("begin", flush=True)
    before, start = [*counts], time.monotonic()
    time.sleep(seconds)
    passed = time.monotonic() - start
    print(*((now - then) / passed for now, then in zip(counts, before)))


if __name__ == "__main__":
    main()
