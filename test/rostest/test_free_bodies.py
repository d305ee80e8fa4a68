"""A robot with floating joints: the base moves in the map, and what is free is set."""

import unittest

import rospy
import tf2_ros
from gazebo_msgs.msg import LinkState, ModelState
from gazebo_msgs.srv import (
    GetLinkState,
    GetModelProperties,
    SetLinkState,
    SetModelState,
)
from geometry_msgs.msg import Point, Pose, Quaternion
from sensor_msgs.msg import JointState
from std_srvs.srv import Empty
from support.ros_testing import DEADLINE, Connected, wait_for

NAME = "flyer"


def call(name, kind, *arguments):
    rospy.wait_for_service(f"/gazebo/{name}", DEADLINE)
    return rospy.ServiceProxy(f"/gazebo/{name}", kind)(*arguments)


def at(x, y, z):
    return Pose(Point(x, y, z), Quaternion(0.0, 0.0, 0.0, 1.0))


def place(link):
    answer = call("get_link_state", GetLinkState, f"{NAME}::{link}", "world")
    assert answer.success, answer.status_message
    p = answer.link_state.pose.position
    return [round(number, 6) for number in (p.x, p.y, p.z)]


class TestFreeBodies(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.states = Connected("joint_states", JointState)
        cls.states.wait()
        cls.buffer = tf2_ros.Buffer()
        cls.transforms = tf2_ros.TransformListener(cls.buffer)

    def seen(self, frame):
        try:
            found = self.buffer.lookup_transform("map", frame, rospy.Time())
        except tf2_ros.TransformException:
            return None
        p = found.transform.translation
        return [round(number, 6) for number in (p.x, p.y, p.z)]

    def test_1_joints_and_links_are_those_gazebo_has(self):
        self.assertEqual(self.states.wait().name, ["elbow"])
        found = call("get_model_properties", GetModelProperties, NAME)
        self.assertEqual(found.body_names, ["base", "arm", "puck"])
        self.assertEqual(found.joint_names, ["elbow"])

    def test_2_the_base_moves_in_the_map(self):
        state = ModelState(model_name=NAME, pose=at(1.0, 2.0, 3.0))
        self.assertTrue(call("set_model_state", SetModelState, state).success)
        wait_for(lambda: self.seen("base") == [1.0, 2.0, 3.0], "the base on TF")
        wait_for(lambda: self.seen("arm") == [1.5, 2.0, 3.0], "the arm on TF")
        self.assertEqual(place("puck"), [1.5, 2.0, 4.0])

    def test_3_a_free_body_is_set_alone(self):
        state = LinkState(link_name=f"{NAME}::puck", pose=at(0.0, 0.0, 5.0))
        self.assertTrue(call("set_link_state", SetLinkState, state).success)
        self.assertEqual(place("puck"), [0.0, 0.0, 5.0])
        self.assertEqual(place("base"), [1.0, 2.0, 3.0])
        state = LinkState(link_name="arm", pose=at(1.5, 2.0, 3.0))
        self.assertTrue(call("set_link_state", SetLinkState, state).success)
        self.assertEqual(place("puck"), [0.0, 0.0, 5.0])
        self.assertEqual(place("base"), [1.0, 2.0, 3.0])

    def test_4_a_reset_brings_all_back(self):
        call("reset_simulation", Empty)
        wait_for(lambda: place("puck")[:2] == [0.5, 0.0], "the puck")
        x, y, z = place("base")
        self.assertEqual([x, y, z + 1.0], [0.0, 0.0, place("puck")[2]])
        wait_for(lambda: self.seen("base") == [x, y, z], "the base on TF")
