"""What the bridge decides without a master: frames, and its robot's rows."""

import numpy as np
import pytest

for module in ("rospy", "tf2_ros", "gazebo_msgs.msg"):
    pytest.importorskip(module, reason=f"{module} is not there")

from g1_description.core.description import parse_urdf  # noqa: E402
from g1_description.core.errors import InvalidValueError  # noqa: E402
from g1_description.ros.bridge_node import Robot, base_child, static_edges  # noqa: E402
from g1_description.ros.link_states import LinkStatesArrays  # noqa: E402
from g1_description.ros.parameters import (  # noqa: E402
    BridgeParameters,
    GazeboParameters,
)


def robot(*links):
    """Make a chain of continuous joints."""
    joints = "".join(
        f'<joint name="to_{child}" type="continuous"><parent link="{parent}"/>'
        f'<child link="{child}"/><axis xyz="0 0 1"/></joint>'
        for parent, child in zip(links, links[1:])
    )
    bodies = "".join(f'<link name="{link}"/>' for link in links)
    return parse_urdf(f'<robot name="r">{bodies}{joints}</robot>')


@pytest.mark.parametrize(
    ("links", "edges"),
    [
        (
            ["pelvis", "imu_in_torso"],
            ["world map", "base_link pelvis", "imu_in_torso body_imu"],
        ),
        (["torso", "arm"], ["world map", "base_link torso"]),
        (["base_link", "arm"], ["world map"]),
        (["base_footprint", "base_link"], ["world map"]),
        (["world", "base_link"], ["world map"]),
    ],
)
def test_static_frames_come_from_the_robot(links, edges):
    found = static_edges(BridgeParameters(), robot(*links))
    assert [" ".join(edge) for edge in found] == edges


@pytest.mark.parametrize(
    ("links", "child"),
    [
        (["pelvis", "arm"], "base_link"),
        (["base_link", "arm"], "base_link"),
        (["base_footprint", "base_link"], "base_footprint"),
        (["world", "base_link"], None),
        (["map", "arm"], None),
    ],
)
def test_no_frame_gets_two_parents(links, child):
    """robot_state_publisher gives every link below the root its parent."""
    assert base_child(BridgeParameters(), robot(*links)) == child


def states(*names):
    poses = np.zeros((len(names), 7))
    poses[:, 6] = 1.0
    return LinkStatesArrays(names, poses, np.zeros((len(names), 6)))


def test_a_robot_is_found_among_others_wherever_it_stands_in_the_list():
    mine = Robot("g1", robot("a", "b", "c"))
    for names in (
        ("ground_plane::link", "g1::a", "g1::b", "g1::c"),
        ("g1::c", "g10::a", "other::b", "g1::b", "g1::a"),
    ):
        message = states(*names)
        mine.find(message.names)
        assert names[mine.root] == "g1::a"
        assert mine.joints.names == ("to_b", "to_c")
        assert not mine.joints.missing
        assert mine.measure(message)[0].tolist() == [0.0, 0.0]


def test_nan_in_a_link_of_the_robot_is_seen_and_of_another_is_not():
    mine = Robot("g1", robot("a", "b"))
    message = states("other::a", "g1::a", "g1::b")
    mine.find(message.names)
    message.poses[0, 0] = np.nan
    assert mine.is_finite(message)
    message.poses[2, 4] = np.inf
    assert not mine.is_finite(message)


def test_the_base_is_the_root_wherever_the_file_has_it():
    text = (
        '<robot name="r"><link name="hand"/><link name="base"/>'
        '<joint name="j" type="continuous"><parent link="base"/>'
        '<child link="hand"/></joint></robot>'
    )
    mine = Robot("g1", parse_urdf(text))
    mine.find(("g1::hand", "g1::base"))
    assert mine.root == 1


def test_a_robot_that_is_not_there_has_no_root():
    mine = Robot("g1", robot("a", "b"))
    mine.find(("ground_plane::link", "g2::a"))
    assert mine.root is None


@pytest.mark.parametrize(
    ("kind", "values", "words"),
    [
        (BridgeParameters, {"max_interval": -1.0}, "~max_interval is -1.0"),
        (BridgeParameters, {"position_threshold": -0.1}, "must be from 0.0"),
        (GazeboParameters, {"time_step": -1.0}, "time_step is -1.0"),
        (GazeboParameters, {"max_update_rate": -1.0}, "max_update_rate"),
    ],
)
def test_parameters_out_of_range_are_refused_by_name(kind, values, words):
    with pytest.raises(InvalidValueError, match=words):
        kind(**values)
