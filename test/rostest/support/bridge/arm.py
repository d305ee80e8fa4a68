"""A small robot, and what a simulator tells of it."""

import math
import time

import rospy
from gazebo_msgs.msg import LinkStates
from geometry_msgs.msg import Pose, Twist
from rosgraph_msgs.msg import Clock

from ..ros_testing import Repeated

MODEL = "arm"
LINKS = ("base", "upper", "fore", "tip")
JOINTS = ("shoulder", "elbow", "slide")
LINK = """<link name="{}"><inertial><mass value="1"/>
  <inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>"""
BODIES = "".join(LINK.format(link) for link in LINKS)
URDF = f"""<robot name="arm">{BODIES}
  <joint name="shoulder" type="continuous">
    <parent link="base"/><child link="upper"/><axis xyz="0 0 1"/></joint>
  <joint name="elbow" type="revolute"><parent link="upper"/><child link="fore"/>
    <axis xyz="0 0 1"/><limit lower="-2" upper="2" effort="1" velocity="1"/></joint>
  <joint name="slide" type="prismatic"><parent link="fore"/><child link="tip"/>
    <axis xyz="0 0 1"/><limit lower="-1" upper="1" effort="1" velocity="1"/></joint>
</robot>"""


def turned(angle):
    """Give a pose at the origin that is turned about z by an angle in [rad]."""
    pose = Pose()
    pose.orientation.z, pose.orientation.w = math.sin(angle / 2), math.cos(angle / 2)
    return pose


def arm_states(shoulder=0.0, elbow=0.0, slide=0.0, model=MODEL):
    """Show the arm behind another model's link.

    Each joint's velocity is its position, as a number.
    """
    message = LinkStates(["ground_plane::link"], [turned(0.0)], [Twist()])
    angles = (0.0, shoulder, shoulder + elbow, shoulder + elbow)
    for link, angle, height in zip(LINKS, angles, (0.0, 0.0, 0.0, slide)):
        pose, twist = turned(angle), Twist()
        pose.position.z = twist.linear.z = height
        twist.angular.z = angle
        message.name.append(f"{model}::{link}")
        message.pose.append(pose)
        message.twist.append(twist)
    return message


def shows(message, positions):
    """Tell whether joint states have these joints, there, and their velocities."""
    return (
        sorted(message.name) == sorted(positions)
        and len(message.position) == len(message.velocity) == len(positions)
        and all(
            abs(found - positions[name]) < 1e-9
            for numbers in (message.position, message.velocity)
            for name, found in zip(message.name, numbers)
        )
    )


def run_clock(period=0.002):
    """Publish /clock at the pace of the wall; the time begins at a hundred seconds."""
    publisher = rospy.Publisher("/clock", Clock, queue_size=1)
    begin = time.monotonic() - 100.0
    return Repeated(
        lambda: publisher.publish(rospy.Time.from_sec(time.monotonic() - begin)),
        period,
    )
