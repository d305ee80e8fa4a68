#!/usr/bin/env python3
"""Stream samples to a robot, and look for them in its joint states.

Arguments: topic, rate in [Hz], time in [s], processes to measure. Prints as JSON what
it saw, and what the processes used of a core in the meantime.
"""

import io
import json
import sys
import time

import numpy as np
import rospy
from g1_description.msg import RobotTrajectory
from geometry_msgs.msg import Transform
from sensor_msgs.msg import JointState
from trajectory_msgs.msg import JointTrajectoryPoint, MultiDOFJointTrajectoryPoint

from bench.motion import TIMEOUT, robot
from bench.nodes import Process, wait_for

CODE = 1e-5  # [rad] from one sample to the next
AFTERWARDS = 1.0  # [s] for what comes late
KINDS = {"motion": RobotTrajectory, "joint_commands": JointState}


def main():
    """Run the node."""
    topic, rate, seconds, *pids = rospy.myargv()[1:]
    rospy.init_node("streamer")
    names = [joint.name for joint in robot().movable_joints]
    came = []
    rospy.Subscriber(
        "/joint_states",
        rospy.AnyMsg,
        lambda message: came.append((time.monotonic(), message._buff)),
        queue_size=None,
        tcp_nodelay=True,
    )
    publisher = rospy.Publisher(f"/{topic}", prepared(KINDS[topic]), queue_size=1000)
    wait_for(lambda: publisher.get_num_connections() and came, "the bridge", TIMEOUT)
    codes = 1.0 + CODE * np.arange(int(float(rate) * float(seconds)))
    messages = [bytes_of(topic, names, code) for code in codes]
    meters = [Process(int(pid)).meter() for pid in pids]
    sent = stream(publisher, messages, float(rate))
    used = [meter() for meter in meters]
    time.sleep(AFTERWARDS)
    shown = first_shown(codes, [*came])
    numbers = [number for number, _ in shown]
    result = {
        "sent": len(sent),
        "shown": len(shown),
        "disorder": int((np.diff(numbers) < 0).sum()),
        "latencies": [moment - sent[number] for number, moment in shown],
        "shares": [cpu / wall for cpu, wall in used],
    }
    print(json.dumps(result))


def prepared(kind):
    """Make a class of messages whose bytes are ready."""

    class Prepared(kind):
        """A message whose bytes are ready."""

        data = b""
        _has_header = False

        def serialize(self, buff):
            """Write the bytes, as rospy asks of a message."""
            buff.write(self.data)

    return Prepared


def bytes_of(topic, names, code):
    """Write a sample: the first joint has the code, the base too."""
    positions = [code] + [0.1 * np.sin(10.0 * code)] * (len(names) - 1)
    if topic == "joint_commands":
        message = JointState(name=names, position=positions)
    else:
        message = RobotTrajectory()
        joints, base = message.joint_trajectory, message.multi_dof_joint_trajectory
        joints.joint_names, base.joint_names = names, ["base"]
        joints.points = [JointTrajectoryPoint(positions=positions)]
        transform = Transform()
        transform.translation.x, transform.translation.z = code, 1.0
        transform.rotation.w = 1.0
        base.points = [MultiDOFJointTrajectoryPoint(transforms=[transform])]
    buffer = io.BytesIO()
    message.serialize(buffer)
    return buffer.getvalue()


def stream(publisher, messages, rate):
    """Send messages at a rate; give the times they were sent, shape (n,)."""
    message, sent = publisher.data_class(), []
    begin = time.monotonic()
    for number, data in enumerate(messages):
        wait = begin + number / rate - time.monotonic()
        if wait > 0.0:
            time.sleep(wait)
        message.data = data
        sent.append(time.monotonic())
        publisher.publish(message)
    return np.array(sent)


def first_shown(codes, came):
    """List which samples were seen, and when first: pairs in order of the states."""
    found, seen = [], set()
    for moment, data in came:
        position = JointState().deserialize(data).position[0]
        number = round((position - codes[0]) / CODE)
        is_sample = 0 <= number < len(codes) and abs(codes[number] - position) < 1e-9
        if is_sample and number not in seen:
            seen.add(number)
            found.append((number, moment))
    return found


if __name__ == "__main__":
    sys.exit(main())
