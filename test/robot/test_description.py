"""Descriptions are read whole, and refused with facts."""

import numpy as np
import pytest
from oracle import angle_of, matrix_of
from scipy.spatial.transform import Rotation

from g1_description.errors import DescriptionError
from g1_description.robot.lumping import lump_fixed_joints
from g1_description.robot.urdf import parse_urdf

A_B = '<link name="a"/><link name="b"/>'


def joint(kind="continuous", parent="a", child="b", inside=""):
    return (
        f'<joint name="ab" type="{kind}"><parent link="{parent}"/>'
        f'<child link="{child}"/>{inside}</joint>'
    )


LIMIT = '<limit lower="{}" upper="{}" effort="7" velocity="8"/>'


def robot(inside):
    return f'<robot name="r">{inside}</robot>'


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "not XML"),
        ("<html><body/></html>", "not URDF"),
        (
            '<robot name="r"/>',
            r"must have one root link, but has none \(it has no links",
        ),
        (robot(A_B), "one root link .got a and b"),
        (robot('<link name="a"/><link name="a"/>'), "two links called a"),
        (robot(A_B + joint(child="c")), "child link c, which does not exist"),
        (robot(A_B + joint("wheel")), "Invalid joint type: wheel"),
        (
            robot(A_B + joint("revolute")),
            "Joint ab is revolute and must have a <limit>",
        ),
        (
            robot(A_B + joint(inside='<axis xyz="0 0 0"/>')),
            "axis of joint ab must not be zero",
        ),
        (
            robot(A_B + joint("revolute", inside=LIMIT.format("nan", "1"))),
            "limits of joint ab are nan to 1: no position is left",
        ),
        (
            robot(
                A_B
                + '<link name="c"/><link name="d"/>'
                + joint()
                + joint(parent="c", child="d").replace('"ab"', '"cd"')
                + joint(parent="d", child="c").replace('"ab"', '"dc"')
            ),
            "Robot 'r' has a loop of joints: d, c; it is not below a",
        ),
        (
            robot(A_B + joint() + joint(parent="b", child="a").replace('"ab"', '"ba"')),
            "none \\(its joints form a loop: b, a\\)",
        ),
    ],
)
def test_a_wrong_file_is_refused_with_facts(text, words):
    with pytest.raises(DescriptionError, match=words):
        parse_urdf(text)


@pytest.mark.parametrize(
    ("kind", "becomes"), [("revolute", "continuous"), ("prismatic", "prismatic")]
)
def test_limits_in_the_wrong_order_are_none_as_in_gazebo(kind, becomes):
    text = robot(BODY + BODY.replace('name="a"', 'name="b"'))
    text = text.replace(
        "</robot>", joint(kind, inside=LIMIT.format(1, -1)) + "</robot>"
    )
    description = parse_urdf(text)
    (found,) = description.joints
    assert (found.kind, found.lower, found.upper) == (becomes, -np.inf, np.inf)
    assert (found.effort, found.velocity) == (7.0, 8.0)
    told = lump_fixed_joints(description).left_out
    assert told == (
        "joint ab has no limits: its lower one, 1, is above its upper one, -1",
    )


BODY = (
    '<link name="a"><inertial><origin xyz="0 0 0"/><mass value="2"/>'
    '<inertia ixx="1" iyy="2" izz="3" ixy="0" ixz="0" iyz="0"/></inertial>'
    '<collision><geometry><box size="1 2 3"/></geometry></collision></link>'
)


@pytest.mark.parametrize("bad", ["nan", "1e300"])
@pytest.mark.parametrize(
    ("good", "words"),
    [
        ('xyz="0 0 0"', "An origin of link a"),
        ('mass value="2"', "The mass of link a"),
        ('ixx="1"', "The inertia of link a"),
        ('size="1 2 3"', "A box of link a"),
    ],
)
def test_a_number_that_is_none_is_refused_with_its_place(good, words, bad):
    first = good.split('"')[1].split()[0]
    text = robot(BODY.replace(good, good.replace(first, bad, 1)))
    assert parse_urdf(robot(BODY)).mass == 2.0
    with pytest.raises(DescriptionError, match=words):
        parse_urdf(text)


def test_a_missing_origin_is_the_identity():
    (only,) = parse_urdf(robot(A_B + joint("fixed"))).joints
    np.testing.assert_array_equal(only.pose, [0, 0, 0, 0, 0, 0, 1])


def test_axes_become_unit_axes():
    inside = '<axis xyz="0 3 4"/><limit lower="0" upper="1" effort="1" velocity="1"/>'
    (only,) = parse_urdf(robot(A_B + joint(inside=inside))).joints
    np.testing.assert_allclose(only.axis, [0.0, 0.6, 0.8])


def test_a_link_without_inertial_has_no_mass_not_zero_mass():
    assert parse_urdf(robot('<link name="a"/>')).links[0].inertial is None


def test_the_inertia_is_turned_to_the_axes_of_the_link():
    text = robot(
        '<link name="a"><inertial><origin xyz="1 2 3" rpy="0 0 1.5707963267948966"/>'
        '<mass value="2"/><inertia ixx="1" iyy="2" izz="3" ixy="0" ixz="0" iyz="0"/>'
        "</inertial></link>"
    )
    inertial = parse_urdf(text).links[0].inertial
    np.testing.assert_allclose(inertial.inertia, np.diag([2.0, 1.0, 3.0]), atol=1e-12)
    np.testing.assert_allclose(inertial.center_of_mass, [1, 2, 3])


@pytest.mark.parametrize(
    ("material", "color"),
    [
        ('<material name="sea"/>', (0.0, 0.25, 0.5, 1.0)),
        ('<material name="sky"/>', None),
        ('<material name="x"><color rgba="1 0 0 0.5"/></material>', (1, 0, 0, 0.5)),
        ('<material name="x"><color rgba="nan 0 0 1"/></material>', None),
    ],
)
def test_a_shape_has_the_colour_of_its_material_or_none(material, color):
    description = parse_urdf(
        '<robot name="r"><material name="sea"><color rgba="0 0.25 0.5 1"/></material>'
        '<link name="a"><visual><geometry><sphere radius="1"/></geometry>'
        f"{material}</visual></link></robot>"
    )
    assert description.links[0].visuals[0].color == color


SHAPE = '<geometry><sphere radius="1"/></geometry>'
MASSES = (
    '<inertial>{}<mass value="2"/>'
    '<inertia ixx="1" iyy="2" izz="3" ixy="0" ixz="0" iyz="0"/></inertial>'
)


@pytest.mark.parametrize(
    "beside",
    [
        '<transmission name="t"/>',
        '<material><color rgba="1 0 0 1"/></material><material/>',
        '<gazebo reference="a"><material>Gazebo/Red</material></gazebo>',
    ],
)
def test_what_stands_beside_links_and_joints_does_no_harm(beside):
    plain, with_more = A_B + joint(), A_B + beside + joint()
    assert parse_urdf(robot(with_more)).links == parse_urdf(robot(plain)).links


@pytest.mark.parametrize(
    "inside",
    [
        '<visual><material><color rgba="1 0 0 1"/></material>%s</visual>',
        '<collision>%s<contact_coefficients mu="0"/><verbose value="x"/></collision>',
    ],
)
def test_what_stands_inside_a_link_does_no_harm(inside):
    only = parse_urdf(robot(f'<link name="a">{inside % SHAPE}</link>')).links[0]
    assert [shape.kind for shape in only.visuals + only.collisions] == ["sphere"]


def test_a_shape_that_is_not_urdf_is_all_that_a_link_loses():
    """As in SDF; the colours stay with their shapes."""
    red = '<material name="red"><color rgba="1 0 0 1"/></material>'
    inside = (
        f'<visual><geometry><ellipsoid radii="1 2 3"/></geometry></visual>'
        f"<visual>{SHAPE}{red}</visual><collision><geometry><plane/></geometry>"
        "</collision><collision><geometry><capsule radius='2' length='3'/></geometry>"
        "</collision>"
    )
    found = parse_urdf(robot(f'<link name="a">{inside}</link>'))
    (link,) = found.links
    assert [(s.kind, s.color) for s in link.visuals] == [("sphere", (1, 0, 0, 1))]
    assert [(s.kind, s.size) for s in link.collisions] == [("capsule", (2.0, 3.0))]
    assert found.unread == lump_fixed_joints(found).left_out[:1]
    assert found.unread == (
        "unsupported shapes: ellipsoid in visual of link a, plane in collision of "
        "link a",
    )


def test_the_quaternion_of_an_origin_is_read():
    origin = '<origin xyz="1 2 3" quat_xyzw="0.2 -0.4 1 0.6"/>'
    inside = f"<collision>{origin}{SHAPE}</collision>{MASSES.format(origin)}"
    text = robot(f'<link name="a">{inside}</link><link name="b"/>')
    text = text.replace("</robot>", f"{joint('fixed', inside=origin)}</robot>")
    found = parse_urdf(text.replace('"r"', '"r" version="1.1"'))
    turned = Rotation.from_quat([0.2, -0.4, 1.0, 0.6])
    for pose in (found.joints[0].pose, found.links[0].collisions[0].pose):
        np.testing.assert_array_equal(pose[:3], [1, 2, 3])
        assert angle_of(Rotation.from_quat(pose[3:]).inv() * turned) < 1e-9
    axes = matrix_of(turned)
    np.testing.assert_allclose(
        found.links[0].inertial.inertia, axes @ np.diag([1, 2, 3]) @ axes.T, atol=1e-12
    )
    assert found.unread == ()


@pytest.mark.parametrize(
    ("attribute", "words"),
    [
        ("1 0 0", "quat_xyzw of joint ab must have 4 numbers"),
        ("0 0 0 0", "quat_xyzw of joint ab must not be zero"),
    ],
)
def test_a_quaternion_that_is_none_is_refused_with_its_place(attribute, words):
    origin = f'<origin quat_xyzw="{attribute}"/>'
    with pytest.raises(DescriptionError, match=words):
        parse_urdf(robot(A_B + joint("fixed", inside=origin)))


def test_attributes_without_effect_are_named():
    inside = (
        '<origin rpy="0 0 1" quat_xyzw="0 0 0 1"/>'
        '<limit effort="1" velocity="1" acceleration="9"/>'
    )
    text = robot(A_B + joint(inside=inside)).replace("<robot", '<robot by="me" x:y="z"')
    found = parse_urdf(text)
    assert found.unread == (
        "unsupported attributes: by of the robot, quat_xyzw of joint ab, acceleration "
        "of joint ab",
    )
    turned = Rotation.from_quat(found.joints[0].pose[3:])
    assert angle_of(turned) == pytest.approx(1.0)


def test_an_axis_that_means_nothing_is_not_read():
    text = robot(A_B + joint("fixed", inside='<axis xyz="none"/>'))
    assert parse_urdf(text).joints[0].kind == "fixed"


@pytest.mark.parametrize(
    ("part", "words"),
    [
        (joint("wheel"), "Invalid joint type: wheel"),
        (joint(inside='<limit lower="0"/>'), "effort"),
        (
            '<link name="c"><collision><geometry><capsule radius="1"/></geometry>'
            "</collision></link>",
            "collision.*length",
        ),
    ],
)
def test_a_part_at_fault_is_named_whatever_stands_before_it(part, words):
    before = '<transmission name="t"/>\n'
    with pytest.raises(DescriptionError, match=words):
        parse_urdf(robot(A_B + before + part))
