"""What the bridge decides without a master: frames, and its robot's rows."""

import pytest
from robots import robot

for module in ("rospy", "tf2_ros", "gazebo_msgs.msg"):
    pytest.importorskip(module, reason=f"{module} is not there")

from g1_description.bridge.parameters import (  # noqa: E402
    BridgeParameters,
    base_child,
    static_edges,
)
from g1_description.errors import InvalidValueError  # noqa: E402
from g1_description.gazebo.parameters import GazeboParameters  # noqa: E402
from g1_description.robot.urdf import parse_urdf  # noqa: E402
from g1_description.sim.engine import PhysicsProperties  # noqa: E402


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
    parameters = BridgeParameters(imu_link="imu_in_torso")
    found = static_edges(parameters, robot(*links))
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


def test_what_floats_in_the_world_moves_in_the_map():
    """robot_state_publisher tells of no floating joint."""
    text = (
        '<robot name="r"><link name="world"/><link name="pelvis"/><joint name="f" '
        'type="floating"><parent link="world"/><child link="pelvis"/></joint></robot>'
    )
    flying = parse_urdf(text)
    assert base_child(BridgeParameters(), flying) == "base_link"
    edges = static_edges(BridgeParameters(), flying)
    assert edges == [("world", "map"), ("base_link", "pelvis")]
    own = parse_urdf(text.replace("pelvis", "base_link"))
    assert base_child(BridgeParameters(), own) == "base_link"
    assert static_edges(BridgeParameters(), own) == [("world", "map")]


def test_frames_of_a_robot_with_a_prefix_keep_world_and_map():
    parameters = BridgeParameters(imu_link="imu_in_torso")
    edges = static_edges(parameters, robot("pelvis", "imu_in_torso"), "a/")
    assert edges == [
        ("world", "map"),
        ("a/base_link", "a/pelvis"),
        ("a/imu_in_torso", "a/body_imu"),
    ]


def test_a_robot_fixed_to_the_world_hangs_in_it_whatever_its_prefix():
    edges = static_edges(BridgeParameters(), robot("world", "arm"), "a/")
    assert edges == [("world", "map"), ("world", "a/world")]


def test_a_robot_in_the_nodes_namespace_has_no_prefix():
    (one,) = BridgeParameters(robots=({"name": "a", "namespace": ""},)).each_robot
    assert (one.namespace, one.frame_prefix) == ("", "")


def test_robots_get_their_namespace_and_prefix_from_their_name():
    parameters = BridgeParameters(robots=({"name": "g1::left"}, {"name": "b"}))
    one, other = parameters.each_robot
    assert (one.namespace, one.frame_prefix) == ("g1__left", "g1__left/")
    assert (other.name, other.description) == ("b", "robot_description")


@pytest.mark.parametrize(
    ("robots", "words"),
    [
        (("a",), "robots.0. must be a dictionary with a name .got 'a'"),
        (({"namespace": "a"},), "a dictionary with a name"),
        (({"name": 3},), "a dictionary with a name"),
        (({"name": "a", "colour": "red"},), "may have strings for .*got colour: 'red'"),
        (({"name": "a", "frame_prefix": 1},), "got frame_prefix: 1"),
        (({"name": "a", "frame_prefix": "b"},), "must end with a slash .*got 'b'"),
        (({"name": "a", "namespace": "3"},), "must be a ROS name .got '3'"),
        (({"name": "a"}, {"name": "a", "namespace": "b"}), "repeat a name .got 'a'"),
        (
            ({"name": "a"}, {"name": "b", "namespace": "/a/"}),
            "repeat a namespace .got 'a'",
        ),
    ],
)
def test_robots_that_make_no_sense_are_refused_by_their_number(robots, words):
    with pytest.raises(InvalidValueError, match=words):
        BridgeParameters(robots=robots)


@pytest.mark.parametrize(
    ("kind", "values", "words"),
    [
        (BridgeParameters, {"frame_prefix": "/a/"}, "end with a slash and not begin"),
        (
            BridgeParameters,
            {"max_interval": -1.0},
            "~max_interval must be .* .got -1.0",
        ),
        (BridgeParameters, {"position_threshold": -0.1}, "must be from 0.0"),
        (
            GazeboParameters,
            {"link_states_rate": -1.0},
            "~link_states_rate must be .* .got -1.0",
        ),
        (PhysicsProperties, {"time_step": -1.0}, "time_step must be .* .got -1"),
        (PhysicsProperties, {"max_update_rate": -1.0}, "max_update_rate"),
    ],
)
def test_parameters_out_of_range_are_refused_by_name(kind, values, words):
    with pytest.raises(InvalidValueError, match=words):
        kind(**values)
