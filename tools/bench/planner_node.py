#!/usr/bin/env python3
"""A planner as one writes it first: send a motion, read what the robot does.

Prints as JSON what it saw, and what it and the processes whose numbers it is given
used of a core in the meantime.
"""

import json
import os
import sys
import time

import numpy as np
import rospy
from sensor_msgs.msg import JointState

from bench.motion import TIMEOUT, Commands, revolute, robot, swing
from bench.nodes import Process, wait_for

RATE = 50.0  # [Hz]
SECONDS = 3.0
EXACT = 1e-9  # [rad]
AFTERWARDS = 1.0  # [s] for what comes late


def main():
    """Run the node."""
    pids = [int(word) for word in rospy.myargv()[1:]] + [os.getpid()]
    rospy.init_node("planner")
    joints = revolute(robot())
    names = [joint.name for joint in joints]
    commands, came = Commands(names), []
    rospy.Subscriber(
        "/joint_states",
        JointState,
        lambda message: came.append((time.monotonic(), message)),
        queue_size=10_000,
        tcp_nodelay=True,
    )
    wait_for(lambda: commands.is_heard and came, "the bridge", TIMEOUT)
    motion = swing(joints, SECONDS, RATE)
    meters = [Process(pid).meter() for pid in pids]
    sent = play(commands, motion)
    used = [meter() for meter in meters]
    rospy.sleep(AFTERWARDS)
    result = {
        "latencies": latencies(motion, sent, names, list(came)),
        "sent": len(sent),
        "close": int((np.diff(sent) < 0.25 / RATE).sum()),
        "repeated": repeated([state for _, state in came]),
        "shares": [cpu / wall for cpu, wall in used],
    }
    print(json.dumps(result))


def play(commands, motion):
    """Send a motion; give the times its samples were sent, shape (n,)."""
    rate, sent = rospy.Rate(RATE), []
    for position in motion:
        sent.append(time.monotonic())
        commands.send(position)
        rate.sleep()
    return np.array(sent)


def latencies(motion, sent, names, came):
    """List the times in [s] after which samples were seen exactly, if they were."""
    times = np.array([now for now, _ in came])
    columns = [came[-1][1].name.index(name) for name in names]
    told = np.array([state.position for _, state in came])[:, columns]
    found = []
    for sample, moment in zip(motion, sent):
        same = np.abs(told - sample).max(axis=1) < EXACT
        seen = times[same & (times >= moment)]
        found += [float(seen[0] - moment)] if seen.size else []
    return found


def repeated(states):
    """Tell the share of stamps that are that of the message before."""
    stamps = [state.header.stamp.to_nsec() for state in states]
    return float(np.mean(np.diff(stamps) == 0))


if __name__ == "__main__":
    sys.exit(main())
