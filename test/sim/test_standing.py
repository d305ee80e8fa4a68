"""How high robots stand, hang and reach down, against scipy and PyBullet.

The package's poses, in which the robot stands and keeps its balance, come first.
"""

import math
import re
from dataclasses import replace
from functools import lru_cache
from random import Random

import numpy as np
import pytest
from conftest import PROFILE
from hypothesis import given, settings
from hypothesis import strategies as st
from oracle import angle_of, forward_kinematics
from robots import chains, world_poses
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation
from worlds import OUR_G1

from g1_description.motion.motion import Motion
from g1_description.robot.lumping import lump_fixed_joints
from g1_description.robot.poses import parse_poses
from g1_description.robot.urdf import parse_urdf
from g1_description.sim.standing import (
    hanging_height,
    lowest_height,
    standing_height,
)

POSES = parse_poses(
    (PROFILE / "poses.yaml").read_text(),
    "poses.yaml",
)
UPRIGHT = np.array([0.0, 0.0, 0.0, 1.0])
ORIGIN = np.array([0.0, 0.0, 0.0, *UPRIGHT])
FEET = ("left_ankle_roll_link", "right_ankle_roll_link")
BALANCED = ["zero", "stand", "squat", "t_pose", "hands_up", "wave"]


INERTIAL = """<inertial><mass value="1"/>
<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>"""


def with_masses(text):
    """Give each link of a URDF 1 kg."""
    text = re.sub(r'(<link name="\w+")/>', r"\1></link>", text)
    return re.sub(r'(<link name="\w+">)', rf"\1{INERTIAL}", text)


def shaped_chains():
    """Draw robots with a box beside each link's origin."""
    box = '<collision><origin xyz="{} {} {}"/><geometry><box size="{} {} {}"/>'
    box += "</geometry></collision></link>"

    def shaped(chain, numbers):
        return chain[0].replace("</link>", box.format(*numbers))

    numbers = st.tuples(*[st.floats(-1.0, 1.0)] * 3, *[st.floats(0.01, 1.0)] * 3)
    return st.builds(shaped, chains(max_joints=5), numbers)


@lru_cache(maxsize=2)
def read(text):
    return lump_fixed_joints(parse_urdf(text))


def in_pose(text, positions):
    return replace(read(text), positions=positions)


def spawn(world, text, positions, rotation=UPRIGHT):
    """Spawn the robot on the floor."""
    assembly = in_pose(text, positions)
    z = standing_height(assembly, rotation)
    world.spawn("g1", assembly, np.array([0.0, 0.0, z, *rotation]))
    return world.model("g1")


def gaps(world, model, reach=0.05):
    """Measure how far each link of a model is from the ground, where within reach."""
    robot, ground = (world.body(n).number for n in (model.name, "ground_plane"))
    distances = {}
    for point in world.client.getClosestPoints(robot, ground, reach):
        name = world.body(model.name).link_names[point[3]]
        distances.setdefault(name, []).append(point[8])
    return distances


@pytest.mark.parametrize("name", POSES)
def test_a_robot_in_a_pose_stands_on_flat_soles_and_keeps_its_balance(
    make_world, g1_text, name
):
    """By PyBullet's distances to the ground, and scipy's centre of mass."""
    world = make_world()
    model = spawn(world, g1_text, POSES[name].positions)
    distances = gaps(world, model)
    assert set(distances) >= set(FEET)
    assert 0.0 < min(map(min, distances.values())) < 0.003
    assert not world.engine.contacts()
    poses = forward_kinematics(g1_text, np.array(model.pose), POSES[name].positions)
    for foot in FEET:
        up = Rotation.from_quat(poses[foot][3:]).apply([0.0, 0.0, 1.0])
        np.testing.assert_allclose(up, [0.0, 0.0, 1.0], atol=1e-3)
    assert poses[FEET[0]][2] == pytest.approx(poses[FEET[1]][2], abs=1e-4)
    if name in BALANCED:
        robot, ground = (world.body(n).number for n in ("g1", "ground_plane"))
        points = world.client.getClosestPoints(robot, ground, 0.005)
        feet = np.array([point[5][:2] for point in points])
        assert margin(feet, center_of_mass(parse_urdf(g1_text), poses)[:2]) > 0.02


def test_a_robot_lying_down_is_on_the_floor_too(make_world, g1_text):
    world = make_world()
    lying = Rotation.from_euler("xyz", [0.0, math.pi / 2, 0.3]).as_quat()
    model = spawn(world, g1_text, POSES["t_pose"].positions, lying)
    lowest = min(map(min, gaps(world, model).values()))
    assert 0.0 < lowest < 0.003


def test_the_height_is_that_of_the_lowest_corner(make_world):
    """A box of 2 m on its corner, capsules, and a robot without shapes, by hand."""
    box = """<robot name="r"><link name="box"><inertial><mass value="1"/>
    <inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>{}</link>
    </robot>"""
    shape = '<collision><geometry><box size="2 2 2"/></geometry></collision>'
    turn = Rotation.from_euler("xyz", [math.pi / 4, math.atan(math.sqrt(0.5)), 1.0])
    lowest_of = {shape: math.sqrt(3.0), "": 0.0}
    for radius, length in ((0.2, 0.6), (0.3, 0.0)):
        size = f'radius="{radius}" length="{length}"'
        capsule = f"<collision><geometry><capsule {size}/></geometry></collision>"
        lowest_of[capsule] = radius + length / 2 * abs(turn.as_matrix()[2, 2])
    for text, lowest in [(box.format(s), lowest) for s, lowest in lowest_of.items()]:
        z = standing_height(in_pose(text, {}), turn.as_quat())
        assert lowest + 0.0005 <= z <= lowest + 0.0016


def center_of_mass(description, poses):
    """Find it by scipy, shape (3,)."""
    masses = [(n.inertial, poses[n.name]) for n in description.links if n.inertial]
    total = sum(inertial.mass for inertial, _ in masses)
    return (
        sum(
            inertial.mass
            * (pose[:3] + Rotation.from_quat(pose[3:]).apply(inertial.center_of_mass))
            for inertial, pose in masses
        )
        / total
    )


def margin(points, point):
    """Tell how far inside the hull of points a point is, in [m]; all shape (2,)."""
    return -(ConvexHull(points).equations @ [*point, 1.0]).max()


def directions(text, name, *pairs):
    """Give unit vectors from the first to the second link of each pair."""
    poses = forward_kinematics(text, ORIGIN, POSES[name].positions)
    ways = np.array([poses[end][:3] - poses[begin][:3] for begin, end in pairs])
    return ways / np.linalg.norm(ways, axis=1)[:, np.newaxis]


@pytest.mark.parametrize(("side", "sign"), [("left", 1.0), ("right", -1.0)])
def test_limbs_point_where_the_names_of_poses_say(g1_text, side, sign):
    upper = f"{side}_shoulder_roll_link", f"{side}_elbow_link"
    fore = f"{side}_elbow_link", f"{side}_wrist_yaw_link"
    thigh = f"{side}_hip_roll_link", f"{side}_knee_link"
    level = np.radians(15.0)
    np.testing.assert_allclose(
        directions(g1_text, "t_pose", upper, fore), [[0.0, sign, 0.0]] * 2, atol=level
    )
    assert (directions(g1_text, "hands_up", upper, fore)[:, 2] > np.cos(level)).all()
    (way,) = directions(g1_text, "sit", thigh)
    assert abs(way[2]) < level
    (shank,) = directions(
        g1_text, "sit", (f"{side}_knee_link", f"{side}_ankle_pitch_link")
    )
    assert shank[2] < -np.cos(level)


@pytest.mark.slow
def test_a_standing_robot_stands_in_hold_and_again_after_a_reset(
    make_world, vendors_g1
):
    """Its pelvis stays within a centimetre from the first step on, and drifts less."""
    world = make_world("hold")
    model = spawn(world, vendors_g1, POSES["stand"].positions)
    wanted = [POSES["stand"].positions.get(name, 0.0) for name in model.joint_names]
    np.testing.assert_array_equal(model.position, wanted)
    np.testing.assert_array_equal(model.target, wanted)
    first = [part.copy() for part in world.link_states()]
    world.step()
    np.testing.assert_allclose(model.position, wanted, atol=1e-3)
    world.set_joint_positions("g1", {"left_elbow_joint": 0.0})
    world.run(0.1)
    world.reset()
    for part, before in zip(world.link_states(), first):
        np.testing.assert_array_equal(part, before)
    np.testing.assert_array_equal(model.target, wanted)
    begin = model.pose
    farthest = 0.0
    for step in range(10):
        if step == 5:
            later = model.pose
        world.run(0.1)
        farthest = max(farthest, np.linalg.norm(model.pose[:3] - begin[:3]))
    assert farthest < 0.01
    assert np.linalg.norm(model.pose[:3] - later[:3]) < 2e-4
    tilt = angle_of(Rotation.from_quat(model.pose[3:]))
    assert tilt < 0.05


def lowest(text, z, rotation, positions):
    """Find the lowest point of a robot's collision shapes by PyBullet, in [m]."""
    assembly = in_pose(text, positions)
    return z - (standing_height(assembly, rotation) - 0.0005)


def drawn(random, text, extreme):
    """Draw positions within the limits, or at one of them."""
    joints = read(text).description.movable_joints
    ends = [(j.lower, j.upper) if np.isfinite(j.upper) else (-4.0, 4.0) for j in joints]
    if extreme:
        return {j.name: random.choice(end) for j, end in zip(joints, ends)}
    return {j.name: random.uniform(*end) for j, end in zip(joints, ends)}


@pytest.mark.parametrize("rpy", [(0.0, 0.0, 0.0), (1.2, -0.7, 2.0)])
def test_no_joint_brings_a_hanging_robot_to_the_floor(rpy):
    random = Random(1)
    rotation = Rotation.from_euler("xyz", rpy).as_quat()
    z = hanging_height(in_pose(OUR_G1, {}), rotation)
    for trial in range(6):
        positions = drawn(random, OUR_G1, extreme=trial % 2)
        assert lowest(OUR_G1, z, rotation, positions) > 0.0, positions


@settings(max_examples=10, deadline=None)
@given(shaped_chains(), world_poses(), st.randoms(use_true_random=False))
def test_any_robot_hangs_clear_of_the_floor(text, pose, random):
    z = hanging_height(in_pose(text, {}), pose[3:])
    for trial in range(4):
        positions = drawn(random, text, extreme=trial % 2)
        assert lowest(text, z, pose[3:], positions) > 0.0


def test_the_height_is_what_a_stretched_arm_reaches():
    """By hand: 0.1 + 0.5 to the slide, 0.3 of travel, half a cube's diagonal."""
    text = """<robot name="r"><link name="base"/><link name="upper"/><link name="hand">
    <collision><geometry><box size="0.2 0.2 0.2"/></geometry></collision></link>
    <joint name="turn" type="continuous"><parent link="base"/><child link="upper"/>
    <origin xyz="0 0 0.1"/></joint><joint name="slide" type="prismatic">
    <parent link="upper"/><child link="hand"/><origin xyz="0.3 0.4 0"/>
    <limit lower="-0.3" upper="0.2" effort="1" velocity="1"/></joint></robot>"""
    z = hanging_height(in_pose(with_masses(text), {}), UPRIGHT)
    reach = 0.1 + 0.5 + 0.3 + 0.1 * math.sqrt(3.0)
    assert reach < z < reach + 0.005


def test_legs_of_a_hanging_robot_swing_freely_in_hold(make_world):
    """A swing of 0.3 rad has 0.94 rad/s at most; the floor makes it 3.8."""
    world = make_world("hold")
    assembly = in_pose(OUR_G1, {})
    z = hanging_height(assembly, UPRIGHT)
    world.spawn("g1", assembly, np.array([0.0, 0.0, z, *UPRIGHT]), fixed_base=True)
    model = world.model("g1")
    legs = [name for name in model.joint_names if "hip" in name or "ankle" in name]
    legs += [name for name in model.joint_names if "knee" in name]
    fastest = 0.0
    for step in range(500):
        if step % 20 == 0:
            angle = 0.3 * math.sin(math.pi * step * 1e-3)
            world.set_joint_positions("g1", dict.fromkeys(legs, angle))
        world.step()
        fastest = max(fastest, np.abs(model.velocity).max())
    assert fastest < 2.0


SHAPES = """<robot name="r"><link name="a">
<collision><origin xyz="0.1 0 0.2" rpy="0.3 0.2 0.1"/><geometry>
<box size="0.4 0.2 0.1"/></geometry></collision></link>
<joint name="j" type="revolute"><parent link="a"/><child link="b"/>
<origin xyz="0 0 -0.3"/><axis xyz="0 1 0"/>
<limit lower="-2" upper="2" effort="1" velocity="1"/></joint>
<link name="b"><visual><origin xyz="0 0 -0.5"/><geometry>
<sphere radius="0.07"/></geometry></visual><visual><origin rpy="0 1.5 0"/><geometry>
<capsule radius="0.06" length="0.4"/></geometry></visual></link></robot>"""


def still(pose, names=(), positions=()):
    return Motion(
        np.zeros(1), tuple(names), np.array([positions]), base_poses=np.array([pose])
    )


def test_boxes_and_round_shapes_are_where_scipy_puts_them():
    random = np.random.RandomState(4)
    robot = parse_urdf(SHAPES)
    for _ in range(10):
        base = Rotation.from_quat(random.normal(size=4))
        place, angle = random.normal(size=3), random.uniform(-2, 2)
        corners = np.array(
            [[x, y, z] for x in (-0.2, 0.2) for y in (-0.1, 0.1) for z in (-0.05, 0.05)]
        )
        box = Rotation.from_euler("xyz", [0.3, 0.2, 0.1]).apply(corners)
        box = base.apply(box + np.array([0.1, 0, 0.2])) + place
        end = Rotation.from_rotvec([0, 1.5, 0]).apply([0, 0, 0.2])
        round_ = Rotation.from_rotvec([0, angle, 0]).apply([[0, 0, -0.5], end, -end])
        round_ = base.apply(round_ + np.array([0, 0, -0.3])) + place
        heights = round_[:, 2] - [0.07, 0.06, 0.06]
        wanted = min(box[:, 2].min(), heights.min())
        pose = np.concatenate([place, base.as_quat()])
        found = lowest_height(robot, still(pose, ["j"], [angle]))
        assert found == pytest.approx(wanted, abs=1e-12)


def test_the_g1_touches_where_pybullet_sees_it_touch(make_world, g1_text):
    """Lowered to its lowest point, within the millimetre of PyBullet's margins."""
    robot = parse_urdf(g1_text)
    pose = np.array([0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0])
    names = ("left_knee_joint", "left_hip_pitch_joint")
    lowest = lowest_height(robot, still(pose, names, (0.6, -0.3)))
    for above, touches in ((0.003, False), (-0.003, True)):
        world = make_world("kinematic")
        pose[2] = 1.0 - lowest + above
        world.spawn_urdf("g1", g1_text, pose)
        world.set_joint_positions("g1", dict(zip(names, (0.6, -0.3))))
        links = {link for pair in world.engine.contacts() for link in pair}
        assert ("ground_plane::link" in links) == touches
        pose[2] = 1.0
