"""A first planner: a squat of base and joints, streamed at 50 Hz, feet still."""

import numpy as np
import rospy
from g1_description.msg import RobotState

from g1_description import Robot, Stream

FEET = ["left_ankle_roll_link", "right_ankle_roll_link"]
robot = Robot()
states = []


def squat(depth):
    """Bend the knees, and place the base so that the left foot stays."""
    joints = dict(zip(robot.joint_names, robot.named_configuration("stand")))
    for side in ("left", "right"):
        joints[f"{side}_hip_pitch_joint"] -= depth
        joints[f"{side}_knee_joint"] += 2 * depth
        joints[f"{side}_ankle_pitch_joint"] -= depth
    foot = robot.link_poses(joints)[FEET[0]]
    return joints, [-foot[0], 0.0, 0.035 - foot[2], 0.0, 0.0, 0.0, 1.0]


with Stream(rate=50) as stream:
    stream.send(*squat(0.0))
    rospy.sleep(0.5)
    rospy.Subscriber("robot_state", RobotState, states.append)
    for time in np.arange(0.0, 4.0, 0.02):
        stream.send(*squat(0.24 * (1.0 - np.cos(np.pi * time))))

states = [*states]  # others still come
bases = [s.base_pose for s in states]
bases = [[b.position.x, b.position.y, b.position.z, 0, 0, 0, 1] for b in bases]
poses = robot.link_poses([s.position for s in states], bases)
print(f"base went down by {np.ptp(bases, axis=0)[2]:.2f} m")
print(f"feet moved by {max(np.ptp(poses[foot], axis=0).max() for foot in FEET):.6f} m")
