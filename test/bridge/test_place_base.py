"""The transforms that place a robot that nothing else places."""

import numpy as np
import pytest
from conftest import REPOSITORY
from scipy.spatial.transform import Rotation

pytest.importorskip("rospy", reason="ROS is not there")

from g1_description.bridge.place_base import BaseParameters, static_base
from g1_description.robot.urdf import parse_urdf

FIVE = parse_urdf((REPOSITORY / "test" / "data" / "five_links.urdf").read_text())
YAW, PITCH, ROLL = 0.3, 0.2, -0.1


def test_yaw_pitch_and_roll_are_those_of_tf():
    base = f"1 2 0.8 {YAW} {PITCH} {ROLL}"
    above, below = static_base(BaseParameters(base, "odom"), FIVE)
    assert (above[:2], below[:2]) == (("odom", "base_link"), ("base_link", "trunk"))
    turn = Rotation.from_euler("ZYX", [YAW, PITCH, ROLL]).as_quat()
    np.testing.assert_allclose(above[2], [1.0, 2.0, 0.8, *turn], atol=1e-12)
    np.testing.assert_array_equal(below[2], [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0])


def test_a_quaternion_and_another_frame_are_taken():
    parameters = BaseParameters("1 2 0.8 0 0 0.6 0.8", "map", "left/trunk")
    ((parent, child, pose),) = static_base(parameters, FIVE)
    assert (parent, child) == ("map", "left/trunk")
    assert pose.tolist() == [1.0, 2.0, 0.8, 0.0, 0.0, 0.6, 0.8]


def test_a_base_link_of_the_robot_is_placed_itself():
    own = parse_urdf('<robot name="r"><link name="base_link"/></robot>')
    ((parent, child, _),) = static_base(BaseParameters("0 0 1 0 0 0"), own)
    assert (parent, child) == ("map", "base_link")
