#!/usr/bin/env python3
"""A bridge as one writes it first: plain rospy, a scipy Rotation per joint.

It is right for joints that turn between limits; limits, axes and origins come from
the file.
"""

import numpy as np
import rospy
from gazebo_msgs.msg import LinkStates
from scipy.spatial.transform import Rotation
from sensor_msgs.msg import JointState
from urdf_parser_py.urdf import URDF

ROBOT = "g1_robot"


class Joint:
    """One joint of the file."""

    def __init__(self, joint):
        """Keep what is constant."""
        self.name = joint.name
        self.parent = f"{ROBOT}::{joint.parent}"
        self.child = f"{ROBOT}::{joint.child}"
        self.zero = Rotation.from_euler("xyz", joint.origin.rpy)
        self.axis = np.array(joint.axis) / np.linalg.norm(joint.axis)
        self.middle = 0.5 * (joint.limit.lower + joint.limit.upper)

    def position(self, parent, child):
        """Measure the joint.

        Args:
            parent: Orientation of its parent link, or many of them.
            child: Orientation of its child link, or as many.

        Returns:
            Positions in [rad], shape () or (n,).
        """
        angle = ((parent * self.zero).inv() * child).as_rotvec() @ self.axis
        return angle + 2.0 * np.pi * np.round((self.middle - angle) / (2.0 * np.pi))


def joints_of(urdf):
    """List the joints of a robot that turn between limits."""
    robot = URDF.from_xml_string(urdf)
    return [Joint(joint) for joint in robot.joints if joint.type == "revolute"]


def rotation(pose):
    """Convert the orientation of a pose."""
    q = pose.orientation
    return Rotation.from_quat([q.x, q.y, q.z, q.w])


class NaiveBridge:
    """Link states in, joint states out."""

    def __init__(self):
        """Read the robot, make the topics."""
        self.joints = joints_of(rospy.get_param("robot_description"))
        self.publisher = rospy.Publisher("joint_states", JointState, queue_size=10)
        rospy.Subscriber("/gazebo/link_states", LinkStates, self.came, queue_size=1)

    def came(self, message):
        """Answer one message."""
        poses = dict(zip(message.name, message.pose))
        answer = JointState()
        answer.header.stamp = rospy.Time.now()
        for joint in self.joints:
            parent, child = rotation(poses[joint.parent]), rotation(poses[joint.child])
            answer.name.append(joint.name)
            answer.position.append(joint.position(parent, child))
        self.publisher.publish(answer)


if __name__ == "__main__":
    rospy.init_node("naive_node")
    NaiveBridge()
    rospy.spin()
