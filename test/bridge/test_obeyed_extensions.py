"""The <gazebo> elements of a URDF are obeyed where things move by themselves."""

import numpy as np
import pytest
from worlds import Bench

from g1_description.bridge.estimator import JointStateEstimator
from g1_description.robot.urdf import parse_urdf

HIGH = np.array([0.3, 0.0, 2.0, 0.0, 0.0, 0.0, 1.0])
MASS = (
    '<inertial><mass value="1"/><inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" '
    'ixz="0" iyz="0"/></inertial>'
)


def link(name):
    return f'<link name="{name}">{MASS}</link>'


def joint(name, kind, parent, child, z=0.0):
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/>'
        f'<child link="{child}"/><origin xyz="1 0 {z}"/><axis xyz="0 1 0"/></joint>'
    )


def robot(*parts):
    return f'<robot name="r">{"".join(parts)}</robot>'


@pytest.fixture(params=["hold", "limp"])
def world(request):
    bench = Bench(request.param)
    yield bench
    bench.close()


def fallen(world, name):
    """How far a link has come down in half a second, in [m]."""
    before = world.link_state(name)[0][2]
    world.run(0.5)
    return before - world.link_state(name)[0][2]


def measured(world, text):
    """The positions of a robot's joints as the bridge sees them, by name."""
    estimator = JointStateEstimator({"r": parse_urdf(text)})
    (seen,) = estimator.update(world.link_names, *world.link_states(), 0)
    return seen.positions_by_name


def test_a_static_robot_does_not_fall_and_is_measured(world):
    static = "<gazebo><static>true</static></gazebo>"
    text = robot(link("a"), link("b"), joint("ab", "continuous", "a", "b"), static)
    world.spawn_urdf("r", text, HIGH)
    assert fallen(world, "r::a") == fallen(world, "r::b") == 0.0
    assert measured(world, text) == {"ab": 0.0}


def test_a_link_without_gravity_does_not_fall(world):
    off = '<gazebo reference="a"><turnGravityOff>true</turnGravityOff></gazebo>'
    world.spawn_urdf("r", robot(link("a"), off), HIGH)
    world.spawn_urdf("other", robot(link("a")), HIGH + np.eye(7)[0])
    assert fallen(world, "r::a") == pytest.approx(0.0, abs=1e-9)
    assert fallen(world, "other::a") > 1.0


@pytest.mark.parametrize(
    ("tag", "kind"),
    [("disableFixedJointLumping", "revolute"), ("preserveFixedJoint", "fixed")],
)
def test_a_kept_joint_holds_its_link_where_it_is(world, tag, kind):
    """And hides nothing from the bridge, which measures what the file says moves."""
    text = robot(
        *(link(name) for name in "abcd"),
        joint("ab", "fixed", "a", "b", z=0.2),
        joint("bc", "continuous", "b", "c"),
        joint("cd", "fixed", "c", "d"),
        f'<gazebo reference="ab"><{tag}>true</{tag}></gazebo>',
    )
    world.spawn_urdf("r", text, HIGH, fixed_base=True)
    assert world.entities.joint("ab").joint.kind == kind
    world.set_joint_positions("r", {"bc": 0.5})
    before = world.link_state("r::b", "r::a")[0]
    world.run(0.5)
    np.testing.assert_allclose(before[:3], [1.0, 0.0, 0.2], atol=1e-9)
    np.testing.assert_allclose(world.link_state("r::b", "r::a")[0], before, atol=1e-3)
    model = world.model("r")
    position = model.position[model.joint_names.index("bc")]
    assert measured(world, text) == {"bc": pytest.approx(position, abs=2e-3)}


def test_a_static_robot_hangs_on_the_world_and_can_be_put_elsewhere(world):
    static = "<gazebo><static>true</static></gazebo>"
    hung = joint("wa", "continuous", "world", "a", z=1.0)
    world.spawn_urdf("r", robot('<link name="world"/>', link("a"), hung, static), HIGH)
    assert world.link_state("r::a")[0][:3] == pytest.approx([1.3, 0.0, 3.0])
    world.put("r", HIGH + np.eye(7)[1], np.zeros(6))
    assert fallen(world, "r::a") == 0.0
    assert world.link_state("r::a")[0][:3] == pytest.approx([1.3, 1.0, 3.0])
