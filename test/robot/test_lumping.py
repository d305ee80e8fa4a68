"""Fixed joints go, mass and shapes stay."""

from dataclasses import fields, is_dataclass, replace

import numpy as np
import pytest
from checked import assert_as_kept
from hypothesis import given, settings
from hypothesis import strategies as st
from robots import BOX, MASS, chains, link, lump
from scipy.spatial.transform import Rotation

from g1_description.robot.assembly import base_of, rigid_frames, root_in_base
from g1_description.robot.lumping import impossible_inertias, lump_fixed_joints
from g1_description.robot.urdf import parse_urdf


def joint(name, kind, parent, child, inside=""):
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/>'
        f'<child link="{child}"/>{inside}</joint>'
    )


def point_masses(inertial, placement):
    """Replace a body by point masses with the same mass, center and inertia.

    Six points on the principal axes; an oracle that needs no parallel axes.
    """
    moments, axes = np.linalg.eigh(inertial.inertia)
    half = 0.5 * (moments.sum() - 2.0 * moments)  # sum of m x^2 along each axis
    arms = np.sqrt(np.maximum(half, 0.0) * 3.0 / inertial.mass)
    points = [
        inertial.center_of_mass + sign * arm * axis
        for arm, axis in zip(arms, axes.T)
        for sign in (1.0, -1.0)
    ]
    turned = Rotation.from_quat(placement[3:]).apply(points) + placement[:3]
    return np.full(6, inertial.mass / 6.0), turned


@settings(max_examples=20)
@given(chains(st.just("fixed")))
def test_inertia_is_that_of_all_the_mass_points(chain):
    robot = parse_urdf(chain[0])
    lumped = lump_fixed_joints(robot)
    (body,) = lumped.description.links
    frames = rigid_frames(robot)
    masses, points = zip(
        *(point_masses(part.inertial, frames[part.name][1]) for part in robot.links)
    )
    mass, point = np.concatenate(masses), np.concatenate(points)
    center = mass @ point / mass.sum()
    arm = point - center
    expected = np.einsum("i,ij,ij", mass, arm, arm) * np.eye(3) - (arm.T * mass) @ arm
    np.testing.assert_allclose(body.inertial.mass, mass.sum())
    np.testing.assert_allclose(body.inertial.center_of_mass, center, atol=1e-9)
    np.testing.assert_allclose(body.inertial.inertia, expected, rtol=1e-9, atol=1e-8)


@settings(max_examples=20)
@given(chains())
def test_lumping_keeps_the_mass_and_the_movable_joints(chain):
    robot = parse_urdf(chain[0])
    lumped = lump_fixed_joints(robot)
    assert lumped.description.mass == pytest.approx(robot.mass, abs=1e-9)
    names = [joint.name for joint in lumped.description.joints]
    assert names == [joint.name for joint in robot.movable_joints]


def test_shapes_move_to_the_body_its_own_first():
    lumped = lump(
        link("tip", BOX.replace("1 1 1", "3 3 3")),
        link("base", MASS + BOX),
        joint("weld", "fixed", "base", "tip", '<origin xyz="0 0 0.5"/>'),
    )
    (body,) = lumped.description.links
    assert body.name == "base"
    assert [shape.size for shape in body.collisions] == [(1, 1, 1), (3, 3, 3)]
    np.testing.assert_array_equal(body.collisions[1].pose, [0, 0, 0.5, 0, 0, 0, 1])


def test_what_hangs_on_the_world_is_fixed_to_it():
    lumped = lump(
        link("world", ""),
        link("mount"),
        joint("anchor", "fixed", "world", "mount", '<origin xyz="0 0 2"/>'),
    )
    assert lumped.description.root == "world"
    assert lumped.link_names == ("mount",)
    (anchor,) = lumped.description.joints
    np.testing.assert_array_equal(anchor.pose, [0, 0, 2, 0, 0, 0, 1])


def test_a_link_without_mass_vanishes_with_all_below_it():
    lumped = lump(
        link("base"),
        link("ghost", ""),
        link("shade", ""),
        link("hand"),
        link("finger"),
        joint("one", "continuous", "base", "ghost"),
        joint("nought", "fixed", "ghost", "shade"),
        joint("two", "continuous", "shade", "hand"),
        joint("three", "continuous", "hand", "finger"),
    )
    assert lumped.description.link_names == ("base",)
    assert lumped.description.joints == ()
    assert lumped.left_out == (
        "link ghost has no mass",
        "link shade has no mass",
        "link hand is below ghost, which has no mass",
        "link finger is below ghost, which has no mass",
    )


def test_a_robot_without_any_mass_has_no_bodies():
    assert lump(link("ghost", "")).description.links == ()


@pytest.mark.parametrize("kind", ["floating", "planar"])
def test_gazebo_makes_no_joint_of_one_without_a_single_position(kind):
    """Its child begins where the joint has it, and has what hangs below."""
    lumped = lump(
        link("a"),
        link("c"),
        link("b"),
        joint("free", kind, "a", "b", '<origin xyz="1 0 0"/>'),
        joint("bc", "continuous", "b", "c"),
    )
    assert lumped.description.roots == ("a", "b")
    assert [joint.name for joint in lumped.description.joints] == ["bc"]
    first, second = lumped.description.trees
    assert (first.link_names, second.link_names) == (("a",), ("c", "b"))
    np.testing.assert_array_equal(lumped.root_poses[:, 0], [0, 1])
    assert lumped.left_out == (f"joint free is {kind}, b is free",)


def test_what_floats_in_the_world_is_the_base():
    lumped = lump(
        link("world", ""),
        link("base"),
        joint("free", "floating", "world", "base", '<origin xyz="0 0 1"/>'),
    )
    assert lumped.description.root == "base"
    assert lumped.link_names == ("base",)
    np.testing.assert_array_equal(lumped.root_poses, [[0, 0, 1, 0, 0, 0, 1]])


def test_collisions_are_named_as_gazebo_names_them_when_it_lumps():
    """Joints in the order of their names; what begins with the body's stays plain."""
    named = BOX.replace("<collision>", '<collision name="hull">')
    parts = [
        link("b", MASS + BOX),
        link("a", MASS + BOX + BOX),
        link("deep", MASS + named),
        link("basement", MASS + BOX),
        joint("zz", "fixed", "base", "basement"),
        joint("z", "fixed", "base", "a"),
        joint("y", "fixed", "base", "b"),
        joint("x", "fixed", "b", "deep"),
    ]
    (body,) = lump(link("base", MASS + BOX), *parts).description.links
    assert [shape.name for shape in body.collisions] == [
        "base_collision",
        "base_fixed_joint_lump__b_collision_1",
        "base_fixed_joint_lump__hull_collision_2",
        "base_fixed_joint_lump__a_collision_3",
        "base_fixed_joint_lump__a_collision_4",
        "basement_collision_5",
    ]
    (body,) = lump(link("base"), *parts).description.links
    assert [shape.name for shape in body.collisions][:2] == [
        "base_fixed_joint_lump__b_collision",
        "base_fixed_joint_lump__hull_collision_1",
    ]


def test_a_bodys_own_collisions_are_named_as_gazebo_names_them():
    shapes = [
        BOX.replace("<collision>", f'<collision name="{name}">')
        for name in ("hull", "base_hull", "")
    ]
    (body,) = lump(link("base", MASS + "".join(shapes))).description.links
    assert [shape.name for shape in body.collisions] == [
        "base_fixed_joint_lump__hull_collision",
        "base_hull_collision_1",
        "base_collision_2",
    ]


def test_nothing_of_the_g1_is_left_out(g1_text):
    assert lump_fixed_joints(parse_urdf(g1_text)).left_out == ()


# --- whole robots -------------------------------------------------------------------

ODD = """<robot name="odd"><link name="a"><inertial><mass value="0"/>
<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="b"><inertial><origin xyz="1 2 3" rpy="0 0 1.5707963"/><mass value="2"/>
<inertia ixx="1" iyy="2" izz="9" ixy="0" ixz="0" iyz="0"/></inertial>
<visual name="v"><origin xyz="0 0 1"/><geometry><mesh filename="file:///m.stl"/>
</geometry></visual>
<visual><geometry><mesh filename="file:///n.stl" scale="2 -3 4"/></geometry></visual>
<collision><geometry><cylinder radius="0.5" length="3"/></geometry></collision>
<collision name="ball"><geometry><sphere radius="0.25"/></geometry></collision></link>
<link name="c"><inertial><mass value="1"/>
<inertia ixx="-1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="d"/><link name="e"/><link name="f"/>
<joint name="ab" type="revolute"><origin xyz="1 0 0"/><parent link="a"/>
<child link="b"/><axis xyz="0 0 2"/>
<limit lower="-1" upper="2" effort="3" velocity="4"/>
<dynamics damping="0.5" friction="0.25"/></joint>
<joint name="bc" type="continuous"><parent link="b"/><child link="c"/></joint>
<joint name="cd" type="prismatic"><parent link="c"/><child link="d"/>
<axis xyz="0 1 0"/><limit upper="2" effort="3" velocity="4"/><dynamics/></joint>
<joint name="de" type="fixed"><parent link="d"/><child link="e"/></joint>
<joint name="ef" type="continuous"><parent link="e"/><child link="f"/></joint>
</robot>"""

BOX_IN = '<visual><geometry><box size="1 2 3"/></geometry><material name="{}</visual>'
RED = BOX_IN.format('red"/>')
OWN = BOX_IN.format('own"><color rgba="0 1 0 1"/></material>')
FIXED = f"""<robot name="fixed">
<material name="red"><color rgba="1 0 0 0.5"/></material>
{link("a", MASS + RED)}{link("b", MASS + OWN)}
{link("c", MASS)}{link("d", MASS)}{link("e", MASS)}
<joint name="ab" type="fixed"><parent link="a"/><child link="b"/></joint>
<joint name="bc" type="fixed"><parent link="b"/><child link="c"/></joint>
<joint name="cd" type="fixed"><parent link="c"/><child link="d"/></joint>
<joint name="de" type="revolute"><parent link="d"/><child link="e"/>
<limit lower="-1e17" upper="1e17" effort="1" velocity="1"/>
<safety_controller k_velocity="1"/></joint>
<gazebo reference="bc"><preserveFixedJoint>1</preserveFixedJoint></gazebo>
<gazebo reference="cd"><disableFixedJointLumping>1</disableFixedJointLumping></gazebo>
<gazebo reference="b"><turnGravityOff>1</turnGravityOff></gazebo>
<gazebo reference="e"><turnGravityOff>1</turnGravityOff><gravity>1</gravity></gazebo>
</robot>"""


def written(value):
    """Write a robot as text: what is not as it is by default."""
    if isinstance(value, np.ndarray):
        return str((np.round(value, 4) + 0.0).tolist())
    if isinstance(value, (tuple, list)):
        return f"({', '.join(map(written, value))})"
    if not is_dataclass(value):
        return repr(value)
    told = []
    for place in fields(value):
        part = getattr(value, place.name)
        if place.repr and (isinstance(part, np.ndarray) or part != place.default):
            told.append(f"{place.name}={written(part)}")
    begin = "\n  " if type(value).__name__ in ("Link", "Joint") else ""
    return f"{begin}{type(value).__name__}({', '.join(told)})"


def test_robots_are_what_they_were(tmp_path):
    lines = []
    for name, text in {"odd": ODD, "fixed": FIXED}.items():
        description = parse_urdf(text)
        lines.append(f"{name}: {written(description)}\n")
        for is_dynamic in (True, False):
            lumped = lump_fixed_joints(description, is_dynamic=is_dynamic)
            lines.append(f"dynamic {is_dynamic}: {written(lumped)}\n")
        lines += [f"{line}\n" for line in impossible_inertias(description.links)]
    assert_as_kept("".join(lines), "robots.txt", tmp_path)


def test_a_joint_begins_inside_its_limits():
    limits = '<limit lower="{}" upper="{}" effort="1" velocity="1"/>'
    ranges = {"low": (-3, -1), "high": (2, 3), "known": (1, 3), "wide": (0, 3)}
    joints = [
        joint(name, "revolute", "root", f"{name}_link", limits.format(*ends))
        for name, ends in ranges.items()
    ]
    links = [link(name) for name in ("root", *(f"{name}_link" for name in ranges))]
    found = replace(lump(*links, *joints), positions={"known": 2.0}, left_out=("x",))
    inside = found.inside_limits()
    assert inside.positions == {"known": 2.0, "low": -1.0, "high": 2.0}
    assert inside.left_out == (
        "x",
        "0 is outside the limits of some joints, which begin at the nearest limit: "
        "low at -1, high at 2",
    )
    assert inside.inside_limits() is inside


def test_names_belong_to_the_innermost_nested_model():
    parts = link("a"), link("b"), joint("ab", "continuous", "a", "b")
    found = replace(lump(*parts), nested=("in", "in::most", "other"))
    names = "in::most::x", "in::x", "in::most", "inner::x", "x", "other::y"
    holders = ["in::most", "in", "in", "", "", "other"]
    assert [*map(found.holder, names)] == holders
    heavy = replace(found.description.links[0], inertial=None)
    other = found.with_link(heavy)
    assert other.description.links == (heavy, *found.description.links[1:])
    assert other.nested == found.nested


def test_the_base_is_the_root_or_what_floats_in_the_world():
    place = '<origin xyz="1 2 3"/>'
    for kind, base in (("floating", "b"), ("planar", "b"), ("fixed", "world")):
        text = "".join(
            [
                '<robot name="r">',
                *(
                    link(name, "" if name == "world" else MASS)
                    for name in ("world", "a", "b")
                ),
                joint("wa", "fixed", "world", "a"),
                joint("wb", kind, "world", "b", place),
                "</robot>",
            ]
        )
        description = parse_urdf(text)
        found, pose = base_of(description)
        back = root_in_base(description)
        assert found == base
        wanted = [1, 2, 3] if base == "b" else [0, 0, 0]
        assert pose[:3].tolist() == wanted
        assert (back[:3] + wanted == 0.0).all()
        lumped = lump_fixed_joints(description)
        assert "world" not in lumped.link_names
    single = parse_urdf(f'<robot name="r">{link("a")}</robot>')
    assert base_of(single)[0] == "a"
    assert root_in_base(single).tolist() == [0, 0, 0, 0, 0, 0, 1]
    lumped = lump_fixed_joints(single)
    assert lumped.link_names == ("a",)
    assert lumped.root_pose.tolist() == [0, 0, 0, 0, 0, 0, 1]
