"""The files of other G1s are made of one table, and have the vendor's figures."""

import sys

import numpy as np
import pytest
import yaml
from conftest import REPOSITORY, VENDOR

from g1_description.api import Robot
from g1_description.motion.motion import Motion
from g1_description.robot.kinematics import Kinematics
from g1_description.robot.transform import IDENTITY
from g1_description.robot.urdf import parse_urdf

sys.path.insert(0, str(REPOSITORY / "tools"))

from shapes.variants import variant

URDF = REPOSITORY / "urdf"
TABLE = yaml.safe_load((URDF / "g1_variants.yaml").read_text())
BASE = (URDF / "g1_29dof.urdf").read_text()
G1 = parse_urdf(BASE)

FIGURES = {
    "g1_29dof_rev_1_0": (29, 33.341142, [-0.0039635, 0, 0.044], 139.0, 6.78),
    "g1_23dof": (23, 34.133857, [-0.0039635, 0, 0.054], 88.0, 8.562),
}
"""Movable joints, mass in [kg], place of the torso on the pelvis in [m], effort of hip
roll in [N m] and mass of the torso in [kg]; those of g1_23dof are from unitree_ros,
robots/g1_description/g1_23dof.urdf."""


def placed(robot, seed, joints):
    """Place all links at random positions of some joints, others at zero."""
    drawn = dict(zip(joints, np.random.default_rng(seed).uniform(-1, 1, len(joints))))
    positions = [drawn.get(joint.name, 0.0) for joint in robot.movable_joints]
    poses = Kinematics(robot).link_poses(np.array(IDENTITY), np.array(positions))
    return dict(zip(robot.link_names, poses))


@pytest.fixture(params=FIGURES)
def name(request):
    return request.param


def test_a_file_is_what_the_table_makes_of_the_base(name):
    made = variant(BASE, name, TABLE[name])
    assert (URDF / f"{name}.urdf").read_text() == made


@pytest.mark.parametrize(
    ("change", "problem"),
    [
        ({"left_tail": None}, "there is no left_tail"),
        ({"torso_link": {"effort": 1}}, "there is no effort in"),
    ],
)
def test_a_change_of_what_the_base_lacks_is_refused(change, problem):
    with pytest.raises(ValueError, match=problem):
        variant(BASE, "g1", {"about": "", **change})


def test_a_variant_has_its_published_figures(name):
    robot = Robot(name)
    count, mass, torso, effort, torso_mass = FIGURES[name]
    assert (robot.name, robot.profile.name) == (name, name)
    assert len(robot.joint_names) == count
    assert robot.description.mass == pytest.approx(mass, abs=1e-6)
    links = {link.name: link for link in robot.description.links}
    joints = {joint.name: joint for joint in robot.description.joints}
    assert links["torso_link"].inertial.mass == torso_mass
    assert joints["left_hip_roll_joint"].effort == effort
    at_zero = placed(robot.description, 0, ())
    np.testing.assert_allclose(at_zero["torso_link"][:3], torso, atol=1e-12)


def test_links_of_g1_23dof_are_where_the_base_has_them():
    """Legs and, with the waist at zero, arms."""
    robot = Robot("g1_23dof").description
    moving = [
        joint.name
        for joint in robot.movable_joints
        if "waist" not in joint.name and "left_wrist" not in joint.name
    ]
    own, base = placed(robot, 7, moving), placed(G1, 7, moving)
    same = {*own} & {*base} - {"torso_link", "waist_roll_link", "mid360_link"}
    assert len(same) > 25
    for link in same:
        np.testing.assert_allclose(own[link], base[link], atol=1e-9, err_msg=link)


def test_revision_1_0_is_the_vendors():
    file = VENDOR.with_name("g1_29dof_rev_1_0.urdf")
    if not file.exists():
        pytest.skip(f"the vendor's {file.name} is not beside the repository")
    vendor, own = parse_urdf(file.read_text()), Robot("g1_29dof_rev_1_0").description
    theirs = {joint.name: joint for joint in vendor.joints}
    assert {*theirs} == {joint.name for joint in own.joints}
    for joint in own.joints:
        other = theirs[joint.name]
        assert (joint.kind, joint.parent, joint.child, joint.lower, joint.upper) == (
            (other.kind, other.parent, other.child, other.lower, other.upper)
        )
        assert (joint.effort, joint.velocity) == (other.effort, other.velocity)
        np.testing.assert_array_equal(joint.pose, other.pose)
        np.testing.assert_array_equal(joint.axis, other.axis)
    links = {link.name: link.inertial for link in vendor.links}
    assert {*links} == {*own.link_names}
    for link in own.links:
        inertial, other = link.inertial, links[link.name]
        if inertial is None or other is None:
            assert inertial is other
            continue
        assert inertial.mass == other.mass
        np.testing.assert_array_equal(inertial.center_of_mass, other.center_of_mass)
        np.testing.assert_array_equal(inertial.inertia, other.inertia)


def test_the_standing_pose_of_a_variant_passes(name):
    """Its soles are on the floor, it is balanced, and no shapes of its own overlap."""
    robot = Robot(name)
    positions = np.tile(robot.named_configuration(robot.profile.standing_pose), (2, 1))
    base = np.tile([0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0], (2, 1))
    motion = Motion(np.arange(2.0), robot.joint_names, positions, None, base)
    standing = robot.on_floor(motion)
    assert standing.base_poses[0, 2] == pytest.approx(0.764, abs=1e-3)
    assert robot.check(standing).findings == ()
    simulated = robot.checker(physics=True).check(standing)
    assert simulated.findings == ()
    assert "patterns" not in " ".join(simulated.notes)
