#!/usr/bin/env python3
"""Call check_state, or listen to what the node checker says of a robot.

Arguments: ``calls`` and a time in [s]; or ``rest``, ``moving`` or ``markers``, a time
in [s] and the process to measure. Prints as JSON what it found.
"""

import json
import time

import numpy as np
import rospy
from diagnostic_msgs.msg import DiagnosticArray
from g1_description.srv import CheckState, CheckStateRequest
from geometry_msgs.msg import Pose
from sensor_msgs.msg import JointState
from visualization_msgs.msg import MarkerArray

from bench.motion import TIMEOUT, robot
from bench.nodes import Process, wait_for

WARM_UP = 3.0  # [s]
NEAR = 0.1
"""Share of the joints' ranges in which configurations are drawn."""
COUNT = 200
CASES = (
    ("at rest, all checks", 0.0, True, ()),
    ("random, all checks", NEAR, True, ()),
    ("random, limits and self-collision", NEAR, False, ("position", "self_collision")),
)


def main():
    """Run the node."""
    case, seconds, *pid = rospy.myargv()[1:]
    rospy.init_node("checker_user")
    if case == "calls":
        result = calls(float(seconds))
    else:
        result = listen(case, float(seconds), Process(int(pid[0])))
    print(json.dumps(result))


def calls(seconds):
    """Call one after the other; give calls per second by case."""
    call = rospy.ServiceProxy("/checker/check_state", CheckState, persistent=True)
    call.wait_for_service(TIMEOUT)
    joints, random = robot().movable_joints, np.random.default_rng(1)
    limits = np.array([[joint.lower, joint.upper] for joint in joints]).T
    names, rates = [joint.name for joint in joints], {}
    for name, near, has_base, only in CASES:
        drawn = near * random.uniform(*limits, (COUNT, len(joints)))
        requests = [
            request(names, np.clip(positions, *limits), has_base, only)
            for positions in drawn
        ]
        count, begin = 0, time.monotonic()
        while time.monotonic() - begin < seconds:
            assert call(requests[count % COUNT]).success
            count += 1
        rates[name] = count / (time.monotonic() - begin)
    return rates


def request(names, positions, has_base, only):
    """Make a request."""
    pose = Pose()
    pose.position.z, pose.orientation.w = 0.793, 1.0
    joints = JointState(name=names, position=[*positions])
    return CheckStateRequest(joints, has_base, pose, list(only))


def listen(case, seconds, process):
    """Listen for a while; give the share of a core, and states judged per second."""
    judged = []

    def take(message):
        for status in message.status:
            if status.name.startswith("checker"):
                values = {value.key: value.value for value in status.values}
                judged.append(float(values["states judged per s"]))

    rospy.Subscriber("/diagnostics", DiagnosticArray, take)
    if case == "markers":
        rospy.Subscriber("/checker/markers", MarkerArray, lambda _: None)
    wait_for(lambda: judged, "a report", TIMEOUT)
    if case != "rest":
        moved = []
        rospy.Subscriber(
            "/joint_states", JointState, lambda m: moved.append(m.position)
        )
        wait_for(lambda: len({*moved}) > 10, "a robot that moves", TIMEOUT)
    time.sleep(WARM_UP)
    judged.clear()
    meter = process.meter()
    time.sleep(seconds)
    cpu, wall = meter()
    return {"share": cpu / wall, "judged": sum(judged) / max(len(judged), 1)}


if __name__ == "__main__":
    main()
