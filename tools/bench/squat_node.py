#!/usr/bin/env python3
"""Move the pelvis up and down above feet that stand still; watch one of them on TF.

Base and joints go out as two messages, as one writes it first. Prints as JSON how far
TF was off.
"""

import json
import sys
import time

import numpy as np
import rospy
import tf2_ros
from gazebo_msgs.msg import ModelState

from bench.motion import TIMEOUT, Commands, robot
from bench.nodes import wait_for
from g1_description.robot.kinematics import Kinematics
from g1_description.robot.transform import IDENTITY

RATE = 100  # [Hz]
SAMPLES = 500
FIRST = 50  # samples before it is watched: the first one is a jump
EVERY = 2  # samples from one look to the next
FOOT = "left_ankle_roll_link"
SOLE = 0.05  # [m] of the foot's frame above the floor
ANGLES = {"hip": -1.0, "knee": 2.0, "ankle": -1.0}


class Squat:
    """The motion."""

    def __init__(self, description):
        """Find what moves."""
        self.names = [joint.name for joint in description.movable_joints]
        self._kinematics = Kinematics(description)
        self._foot = list(description.link_names).index(FOOT)
        self._shares = np.zeros(len(self.names))
        for side in ("left", "right"):
            for joint, share in ANGLES.items():
                kind = "" if joint == "knee" else "_pitch"
                self._shares[self.names.index(f"{side}_{joint}{kind}_joint")] = share

    def at(self, t):
        """Give the pelvis' pose, and positions of the joints, at a time in [s]."""
        position = (0.4 + 0.3 * np.sin(np.pi * t)) * self._shares
        foot = self._kinematics.link_poses(IDENTITY, position)[self._foot]
        return np.array([-foot[0], 0.0, SOLE - foot[2], *IDENTITY[3:]]), position


def model_state(pose):
    """Write where the pelvis goes."""
    message = ModelState(model_name="g1_robot", reference_frame="world")
    place, turn = message.pose.position, message.pose.orientation
    place.x, place.y, place.z = pose[:3]
    turn.x, turn.y, turn.z, turn.w = pose[3:]
    return message


def main():
    """Run the node."""
    rospy.init_node("squat")
    squat = Squat(robot())
    commands = Commands(squat.names)
    base = rospy.Publisher("/gazebo/set_model_state", ModelState, queue_size=100)
    buffer = tf2_ros.Buffer()
    tf2_ros.TransformListener(buffer, tcp_nodelay=True)

    def is_ready():
        heard = commands.is_heard and base.get_num_connections()
        return heard and buffer.can_transform("map", FOOT, rospy.Time())

    wait_for(is_ready, "the bridge and TF", TIMEOUT)
    print(json.dumps(watch(squat, commands, base, buffer)))


def watch(squat, commands, base, buffer):
    """Move, and look; give errors in [mm], and looks that found nothing."""
    due, errors, missed = time.monotonic(), [], 0
    for sample in range(SAMPLES):
        pose, position = squat.at(sample / RATE)
        base.publish(model_state(pose))
        commands.send(position)
        if sample > FIRST and sample % EVERY == 0:
            try:
                found = buffer.lookup_transform("map", FOOT, rospy.Time())
                place = found.transform.translation
                errors.append((1e3 * place.x, 1e3 * (place.z - SOLE)))
            except tf2_ros.TransformException:
                missed += 1
        due = max(due + 1.0 / RATE, time.monotonic())
        time.sleep(max(0.0, due - time.monotonic()))
    errors = np.abs(errors)
    rms = np.sqrt((errors**2).mean(axis=0))
    return {
        "rms": rms.tolist(),
        "worst": errors.max(axis=0).tolist(),
        "missed": missed,
    }


if __name__ == "__main__":
    sys.exit(main())
