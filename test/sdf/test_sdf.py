"""SDF is read with the meaning Gazebo gives it, and refused with facts."""

import re

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from lxml import etree
from oracle import matrix_of
from scipy.spatial.transform import Rotation

from g1_description.errors import DescriptionError, NoSuchModelError
from g1_description.robot.kinematics import Kinematics
from g1_description.sdf.world import EMPTY_WORLD, read_sdf

GOLDEN_LAMP = (  # data/golden/models/lamp.sdf, seen in Gazebo 11.1.0
    '<sdf version="1.6"><light type="point" name="lamp"><pose>1 2 3 0 0 0</pose>'
    "<diffuse>0.5 0.25 0.125 1</diffuse><specular>0.1 0.1 0.1 1</specular>"
    "<attenuation><range>20</range><constant>0.5</constant><linear>0.25</linear>"
    "<quadratic>0.125</quadratic></attenuation><direction>0 0 -1</direction>"
    "</light></sdf>"
)
HALF_PI = "1.5707963267948966"
NUMBER = st.floats(-3.0, 3.0).map(lambda value: round(value, 6))
POSE = st.lists(NUMBER, min_size=6, max_size=6)
AXIS = st.lists(NUMBER, min_size=3, max_size=3).filter(
    lambda axis: np.linalg.norm(axis) > 0.1
)


def sdf(inside, version="1.7"):
    return f'<sdf version="{version}">{inside}</sdf>'


def world(inside):
    return sdf(f'<world name="w">{inside}</world>')


def model(inside, name="m", static=False):
    still = "<static>true</static>" if static else ""
    return f'<model name="{name}">{still}{inside}</model>'


def link(name="a", inside=""):
    return f'<link name="{name}">{inside}</link>'


def joint(kind="revolute", parent="a", child="b", inside="", name="ab"):
    return (
        f'<joint name="{name}" type="{kind}"><parent>{parent}</parent>'
        f"<child>{child}</child>{inside}</joint>"
    )


def collision(geometry, inside="", tag="collision"):
    return f'<{tag} name="c"><geometry>{geometry}</geometry>{inside}</{tag}>'


A_B = link("a") + link("b")


def read_model(inside, version="1.7", **options):
    (found,) = read_sdf(sdf(model(inside, **options), version)).models
    return found


def read_joint(inside="", kind="revolute", links=A_B, version="1.7"):
    assembly = read_model(links + joint(kind, inside=inside), version).assembly
    (found,) = assembly.description.joints
    return found


def read_shape(geometry, inside=""):
    found = read_model(link("a", collision(geometry, inside))).assembly
    (only,) = found.description.links
    (shape,) = only.collisions
    return shape


def matrix(pose):
    """Turn x y z roll pitch yaw, or a pose of seven numbers, into shape (4, 4)."""
    turn = Rotation.from_euler("xyz", pose[3:]) if len(pose) == 6 else None
    result = np.eye(4)
    result[:3, 3] = pose[:3]
    result[:3, :3] = matrix_of(turn or Rotation.from_quat(pose[3:]))
    return result


def text(values):
    return " ".join(repr(float(value)) for value in values)


def screw(kind, point, direction, value):
    """Move along or about a line that stands in the model, shape (4, 4)."""
    result = np.eye(4)
    if kind == "prismatic":
        result[:3, 3] = direction * value
        return result
    turn = matrix_of(Rotation.from_rotvec(direction * value))
    result[:3, :3] = turn
    result[:3, 3] = point - turn @ point
    return result


@st.composite
def trees(draw):
    """Draw a model, and where each of its links is by the product of exponentials.

    A link's pose is written in the model or in any link before it, a joint's in its
    child or in the model, an axis in the joint or in the model.
    """
    names, parts = ["root"], []
    first = draw(POSE)
    rest = {"root": matrix(first)}
    motion, positions = {"root": np.eye(4)}, []
    parts.append(link("root", f"<pose>{text(first)}</pose>"))
    for number in range(draw(st.integers(1, 5))):
        name, parent = f"link_{number}", draw(st.sampled_from(names))
        kind = draw(st.sampled_from(["revolute", "continuous", "prismatic", "fixed"]))
        frame, pose = draw(st.sampled_from(["", "__model__", *names])), draw(POSE)
        rest[name] = rest.get(frame, np.eye(4)) @ matrix(pose)
        given_in = f' relative_to="{frame}"' if frame else ""
        parts.append(link(name, f"<pose{given_in}>{text(pose)}</pose>"))
        names.append(name)

        in_model, joint_pose = draw(st.booleans()), draw(POSE)
        base = np.eye(4) if in_model else rest[name]
        model_joint = base @ matrix(joint_pose)
        axis_in_model, axis = draw(st.booleans()), np.array(draw(AXIS))
        turn = np.eye(3) if axis_in_model else model_joint[:3, :3]
        direction = turn @ axis / np.linalg.norm(axis)
        value = 0.0 if kind == "fixed" else draw(NUMBER)
        if kind != "fixed":
            positions.append(value)
        motion[name] = motion[parent] @ screw(
            kind, model_joint[:3, 3], direction, value
        )
        relative = ' relative_to="__model__"' if in_model else ""
        expressed = ' expressed_in="__model__"' if axis_in_model else ""
        inside = f"<pose{relative}>{text(joint_pose)}</pose>"
        inside += f"<axis><xyz{expressed}>{text(axis)}</xyz></axis>"
        parts.append(joint(kind, parent, name, inside, name=f"joint_{number}"))
    poses = np.array([motion[name] @ rest[name] for name in names])
    return "".join(parts), np.array(positions), poses, [rest[name] for name in names]


@settings(max_examples=10)
@given(trees(), st.booleans())
def test_links_are_where_the_product_of_exponentials_puts_them(tree, anchored):
    inside, positions, expected, _ = tree
    if anchored:
        inside += joint("fixed", "world", "root", name="anchor")
    assembly = read_model(inside).assembly
    poses = Kinematics(assembly.description).link_poses(assembly.root_pose, positions)
    actual = [matrix(pose) for pose in poses]
    np.testing.assert_allclose(actual, expected, atol=1e-9)
    assert assembly.description.root == ("world" if anchored else "root")
    assert assembly.link_names[0] == "root"


@settings(max_examples=10)
@given(trees(), st.integers(0, 5))
def test_a_static_model_stands_as_written_whatever_its_joints(tree, kept):
    inside, _, _, expected = tree
    pieces = inside.split("<joint")
    text_kept = "<joint".join(pieces[: kept + 1])
    lost = [piece.split("</joint>", 1)[1] for piece in pieces[kept + 1 :]]
    assembly = read_model(text_kept + "".join(lost), static=True).assembly
    description = assembly.description
    poses = Kinematics(description).link_poses(assembly.root_pose, np.zeros(0))
    np.testing.assert_allclose([matrix(p) for p in poses], expected, atol=1e-9)
    assert {found.kind for found in description.joints} <= {"fixed"}
    listed = [found.name for found in description.joints if found.listed]
    assert listed == [f"joint_{n}" for n in range(min(kept, len(pieces) - 1))]


@settings(max_examples=15)
@given(POSE, st.lists(st.floats(0.1, 5.0), min_size=6, max_size=6))
def test_the_inertia_is_turned_to_the_axes_of_the_link(pose, tensor):
    tags = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
    values = "".join(f"<{tag}>{n!r}</{tag}>" for tag, n in zip(tags, tensor))
    found = read_model(
        link(
            "a",
            f"<inertial><pose>{text(pose)}</pose><mass>2.5</mass>"
            f"<inertia>{values}</inertia></inertial>",
        )
    ).assembly.description.links[0]
    xx, xy, xz, yy, yz, zz = tensor
    given_tensor = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    turn = matrix_of(Rotation.from_euler("xyz", pose[3:]))
    assert found.inertial.mass == 2.5
    np.testing.assert_allclose(found.inertial.center_of_mass, pose[:3], atol=1e-12)
    for spin in np.eye(3):  # the energy of a spin does not depend on the axes
        energy = (turn.T @ spin) @ given_tensor @ (turn.T @ spin)
        np.testing.assert_allclose(spin @ found.inertial.inertia @ spin, energy)


def test_a_link_without_inertial_has_the_mass_that_sdf_gives_it():
    (found,) = read_model(link()).assembly.description.links
    assert found.inertial.mass == 1.0
    np.testing.assert_array_equal(found.inertial.inertia, np.eye(3))


@pytest.mark.parametrize(
    ("pose", "expected"),
    [
        ("<pose/>", [0, 0, 0, 0, 0, 0]),
        (
            '<pose degrees="true">1 2 3 90 0 45</pose>',
            [1, 2, 3, np.pi / 2, 0, np.pi / 4],
        ),
        (
            '<pose rotation_format="quat_xyzw">1 2 3 0 0 2 2</pose>',
            [1, 2, 3, 0, 0, np.pi / 2],
        ),
    ],
)
def test_a_pose_is_read_in_each_of_its_forms(pose, expected):
    found = read_model(pose + link(), version="1.9")
    np.testing.assert_allclose(matrix(found.pose), matrix(expected), atol=1e-12)
    np.testing.assert_allclose(np.linalg.norm(found.pose[3:]), 1.0)


QUARTER_TURNED_B = link("a") + link("b", f"<pose>0 0 0 0 0 {HALF_PI}</pose>")
X_AXIS = "<axis><xyz>1 0 0</xyz>{}</axis>"


@pytest.mark.parametrize(
    ("version", "inside", "axis_in_child"),
    [
        ("1.6", "", [0, 0, 1]),
        (
            "1.6",
            X_AXIS.format("<use_parent_model_frame>1</use_parent_model_frame>"),
            [0, -1, 0],
        ),
        ("1.4", X_AXIS.format(""), [0, -1, 0]),
        ("1.7", '<axis><xyz expressed_in="a">1 0 0</xyz></axis>', [0, -1, 0]),
        ("1.7", f"<pose>0 0 0 0 0 {HALF_PI}</pose>" + X_AXIS.format(""), [0, 1, 0]),
    ],
)
def test_an_axis_is_turned_to_the_child_link(version, inside, axis_in_child):
    found = read_joint(inside, links=QUARTER_TURNED_B, version=version)
    np.testing.assert_allclose(found.axis, axis_in_child, atol=1e-12)


def test_a_pose_of_an_old_file_names_its_frame_in_another_way():
    inside = A_B.replace('<link name="b">', '<link name="b"><pose frame="f"/>')
    inside += '<frame name="f"><pose>0 0 1 0 0 0</pose></frame>' + joint("fixed")
    (found,) = read_model(inside, version="1.6").assembly.description.joints
    np.testing.assert_allclose(found.pose[:3], [0, 0, 1])


LIMIT = "<axis><limit>{}</limit></axis>"


@pytest.mark.parametrize(
    ("kind", "limit", "expected"),
    [
        ("revolute", "", ("continuous", -np.inf, np.inf)),
        (
            "revolute",
            "<lower>-1e16</lower><upper>1e+16</upper>",
            ("continuous", -np.inf, np.inf),
        ),
        ("revolute", "<lower>-1.5</lower>", ("revolute", -1.5, np.inf)),
        (
            "revolute",
            "<lower>-1.5</lower><upper>2</upper>",
            ("revolute", -1.5, 2.0),
        ),
        ("prismatic", "<upper>2</upper>", ("prismatic", -np.inf, 2.0)),
    ],
)
def test_limits_tell_whether_a_joint_has_an_end(kind, limit, expected):
    found = read_joint(LIMIT.format(limit), kind)
    assert (found.kind, found.lower, found.upper) == expected


def test_a_joint_has_the_damping_and_friction_of_the_file():
    found = read_joint(
        "<axis><dynamics><damping>0.5</damping><friction>0.25</friction></dynamics></axis>"
    )
    assert (found.damping, found.friction) == (0.5, 0.25)


@pytest.mark.parametrize(
    ("geometry", "kind", "size", "filename"),
    [
        ("<box><size>1 2 3</size></box>", "box", (1, 2, 3), ""),
        ("<capsule/>", "capsule", (0.5, 1), ""),
        ("<sphere><radius>2</radius></sphere>", "sphere", (2,), ""),
        (
            "<cylinder><length>3</length><radius>2</radius></cylinder>",
            "cylinder",
            (2, 3),
            "",
        ),
        ("<plane><normal>0 0 -4</normal></plane>", "plane", (0, 0, -1), ""),
        (
            "<mesh><uri> model://a/b.dae </uri><scale>1 2 -3</scale></mesh>",
            "mesh",
            (1, 2, -3),
            "model://a/b.dae",
        ),
    ],
)
def test_a_shape_is_as_large_as_the_file_says(geometry, kind, size, filename):
    shape = read_shape(geometry)
    assert (shape.kind, shape.size, shape.filename) == (kind, size, filename)
    assert (shape.name, shape.friction, shape.restitution) == ("c", None, None)


def test_a_shape_rubs_and_bounces_as_the_file_says():
    shape = read_shape(
        "<box/>",
        "<surface><friction><ode><mu>0.75</mu></ode></friction><bounce>"
        "<restitution_coefficient>0.5</restitution_coefficient></bounce></surface>",
    )
    assert (shape.friction, shape.restitution) == (0.75, 0.5)


@pytest.mark.parametrize(
    ("inside", "color"),
    [
        ("", None),
        ("<material><ambient>1 0 0 1</ambient></material>", (1, 0, 0, 1)),
        (
            "<material><ambient>1 0 0 1</ambient><diffuse>0 1 0</diffuse></material>",
            (0, 1, 0, 1),
        ),
        ("<transparency>0.25</transparency>", (0.7, 0.7, 0.7, 0.75)),
        (
            "<material><script><uri>u</uri><name>Gazebo/BlueTransparent</name>"
            "</script></material><transparency>0.5</transparency>",
            (0, 0, 1, 0.25),
        ),
        ("<material><script><name>Own/Red</name></script></material>", None),
    ],
)
def test_a_visual_is_drawn_as_gazebo_does(inside, color):
    model = read_model(link("a", collision("<box/>", inside, "visual")))
    (only,) = model.assembly.description.links
    (shape,) = only.visuals
    assert (shape.kind, shape.size, only.collisions) == ("box", (1, 1, 1), ())
    assert shape.color == (color if color is None else pytest.approx(color))
    assert not model.assembly.left_out


@pytest.mark.parametrize(
    ("geometry", "inside", "message"),
    [
        ("<polyline/>", "", "Its shape polyline is not supported"),
        ("<mesh><uri>u</uri><submesh/></mesh>", "", "A submesh is not supported"),
        ("<sphere><radius>x</radius></sphere>", "", "must be a number"),
        ("<box/>", "<material><diffuse>1</diffuse></material>", "must have 3 numbers"),
        ("<box/>", "<transparency>1</transparency>", ""),
    ],
)
def test_a_wrong_visual_is_left_out_of_its_link(geometry, inside, message):
    visuals = collision(geometry, inside, "visual") + collision("<box/>", "", "visual")
    assembly = read_model(link("a", visuals)).assembly
    (only,) = assembly.description.links
    assert [shape.kind for shape in only.visuals] == ["box"]
    assert len(assembly.left_out) == bool(message)
    assert message in " ".join(assembly.left_out)


def test_the_filename_of_a_mesh_in_version_1_3_is_its_uri():
    inside = collision("<mesh><filename>a/b.stl</filename></mesh>")
    text = sdf(model(link("a", inside)), "1.3")
    (found,) = read_sdf(text).models[0].assembly.description.links
    assert [shape.filename for shape in found.collisions] == ["a/b.stl"]
    with pytest.raises(DescriptionError, match="no uri"):
        read_sdf(text.replace("1.3", "1.4"))


def test_a_negative_or_huge_coefficient_of_friction_is_infinite():
    """Gazebo takes a negative one for the largest number that there is."""
    mu = "-1"
    surface = f"<friction><ode><mu>{mu}</mu><mu2>{mu}</mu2></ode></friction>"
    inside = collision("<box/>", f"<surface>{surface}</surface>")
    assembly = read_model(link("a", inside)).assembly
    assert assembly.description.links[0].collisions[0].friction == np.inf
    assert assembly.left_out == ()


@pytest.mark.parametrize(
    ("word", "pulled"), [("", True), ("False", False), ("0", False)]
)
def test_gravity_pulls_a_link_unless_the_file_says_no(word, pulled):
    (found,) = read_model(
        link("a", f"<gravity>{word}</gravity>")
    ).assembly.description.links
    assert found.has_gravity is pulled


def test_models_inside_of_a_model_become_part_of_it():
    inner = model(
        f"<pose>1 0 0 0 0 {HALF_PI}</pose>"
        + link("b", "<pose>1 0 0 0 0 0</pose>")
        + link("c", '<pose relative_to="b">0 0 1 0 0 0</pose>')
        + joint("fixed", "b", "c", name="bc"),
        name="inner",
    )
    tip = link("d", '<pose relative_to="inner">0 0 5 0 0 0</pose>')
    chain = joint("fixed", "a", "inner::b") + joint("fixed", "a", "d", name="ad")
    assembly = read_model(link("a") + tip + inner + chain).assembly
    description = assembly.description
    assert description.link_names == ("a", "d", "inner::b", "inner::c")
    assert {found.name for found in description.joints} == {"ab", "ad", "inner::bc"}
    poses = Kinematics(description).link_poses(assembly.root_pose, np.zeros(0))
    expected = [[0, 0, 0], [1, 0, 5], [1, 1, 0], [1, 1, 1]]
    np.testing.assert_allclose(poses[:, :3], expected, atol=1e-12)


def test_what_stands_before_the_declaration_does_no_harm():
    text = "\ufeff <!-- a -->" + '<?xml version="1.0"?>\n' + sdf(model(link()))
    assert [read.name for read in read_sdf(text).models] == ["m"]


BAD_NUMBERS = [
    "nan",
    "1e300",
    "one",
]


@pytest.mark.parametrize("bad", BAD_NUMBERS)
@pytest.mark.parametrize(
    ("inside", "words"),
    [
        ("<pose>{} 0 0 0 0 0</pose>", "pose of link a"),
        ("<inertial><mass>{}</mass></inertial>", "mass of link a"),
        (
            "<inertial><inertia><ixy>{}</ixy></inertia></inertial>",
            "ixy of link a",
        ),
        (
            collision("<sphere><radius>{}</radius></sphere>"),
            "radius of collision c of link a",
        ),
        (collision("<box><size>1 1 {}</size></box>"), "size of collision c of link a"),
    ],
)
def test_a_number_that_is_none_is_refused_with_its_place(inside, words, bad):
    read_model(link("a", inside.format("1")))
    with pytest.raises(DescriptionError, match=f"[Tt]he {words}"):
        read_model(link("a", inside.format(bad)))


@pytest.mark.parametrize(("written", "meant"), [("1.0 kg", 1), ("3,5", 3)])
def test_what_follows_a_number_is_passed_over_and_told(written, meant):
    mass = f"<inertial><mass>{written}</mass></inertial>"
    assembly = read_model(link("a", mass)).assembly
    assert assembly.description.links[0].inertial.mass == meant
    (told,) = assembly.left_out
    assert told == f"mass of link a is '{written.strip()}' and is read as {meant}"


@pytest.mark.parametrize(
    ("written", "meant"),
    [
        ("1 2 3", [1, 2, 3, 0, 0, 0]),
        ("1 2 3 0 0 1.5 9", [1, 2, 3, 0, 0, 1.5]),
        ("1 2", [0, 0, 0, 0, 0, 0]),
    ],
)
def test_a_pose_of_other_than_six_numbers_is_read_as_gazebo_does(written, meant):
    found = read_model(f"<pose>{written}</pose>" + link())
    np.testing.assert_allclose(matrix(found.pose), matrix(meant), atol=1e-12)
    (told,) = found.assembly.left_out
    numbers = " ".join(str(number) for number in meant)
    assert told == f"pose of model m is '{written}' and is read as {numbers}"


@pytest.mark.parametrize("version", ["", "1.0", "x"])
def test_a_version_that_is_not_known_is_read_and_told(version):
    text = sdf(model(link()), version).replace(' version=""', "")
    found = read_sdf(text)
    assert [read.name for read in found.models] == ["m"]
    (told,) = found.left_out
    assert version in told
    assert told.endswith(f"is read as version {'1.4' if version == '1.3' else '1.9'}")


def test_gravity_stands_in_the_physics_up_to_version_1_5():
    version = "1.4"
    physics = "<physics><gravity>0 0 -1.6</gravity></physics>"
    text = sdf(f'<world name="w">{physics}</world>', version)
    assert read_sdf(text).gravity == (0.0, 0.0, -1.6)
    both = f'<world name="w"><gravity>0 0 -2</gravity>{physics}</world>'
    assert read_sdf(sdf(both, version)).gravity == (0.0, 0.0, -2.0)


LOOP = joint("fixed", "b", "c", name="bc") + joint("fixed", "c", "b", name="cb")


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("no xml", "not XML"),
        ('<!DOCTYPE sdf><sdf version="1.7"><model/></sdf>', "DOCTYPE"),
        ('<robot name="r"/>', "root element .*robot"),
        (
            sdf("<actor name='x'/>"),
            "no model, light or world: actor of the file is not simulated.$",
        ),
        (sdf(model("")), "Model 'm' has no links"),
        (sdf(model(A_B + link("a"))), "name a is used twice in model 'm'"),
        (
            sdf(model(A_B + link("c") + joint() + joint(child="c"))),
            "two joints called ab",
        ),
        (
            sdf(model(A_B + joint(inside="<axis><xyz>0 0 0</xyz></axis>"))),
            "axis of joint ab must not be zero",
        ),
        (
            sdf(model(A_B + joint(inside=LIMIT.format("<lower>1e16</lower>")))),
            "limits of joint ab are inf to inf",
        ),
        (
            sdf(
                model(
                    A_B
                    + joint(
                        inside="<axis><dynamics><damping>-1</damping></dynamics></axis>"
                    )
                )
            ),
            "damping of joint ab .* from 0 to",
        ),
        (
            sdf(model(link("a", "<inertial><mass>0</mass></inertial>"))),
            "mass of link a of model 'm' must not be 0",
        ),
        (
            sdf(model(link("a", collision("<box><size>1 -1 1</size></box>")))),
            "size of collision c of link a .* from 0 to",
        ),
        (
            sdf(model(link("a", "<gravity>maybe</gravity>"))),
            "gravity of link a must be true or false .*'maybe'",
        ),
        (
            sdf(model(link("a", '<pose relative_to="x"/>'))),
            "Unknown frame x in model 'm'",
        ),
        (
            sdf(
                model(
                    link("a", '<pose relative_to="b"/>')
                    + link("b", '<pose relative_to="a"/>'),
                    static=True,
                )
            ),
            "frames of model 'm' refer to each other in a loop: a on b on a",
        ),
        (
            world("<physics><max_step_size>-1</max_step_size></physics>"),
            "max_step_size of the physics .* from 0 to",
        ),
        (
            sdf('<light name="l" type="laser"/>'),
            "Unknown type 'laser' of light l",
        ),
        (
            sdf(model(link() + "<include/>")),
            "include in the SDF has no uri",
        ),
        (
            sdf('<include merge="true"><uri>model://sun</uri></include>'),
            "include of model://sun has merge",
        ),
    ],
)
def test_a_wrong_file_is_refused_with_facts(text, words):
    with pytest.raises(DescriptionError, match=words):
        read_sdf(text)


@pytest.mark.parametrize(
    ("inside", "clauses"),
    [
        (link("a", '<sensor name="s" type="imu"/>' * 2), ["sensor of link a"]),
        (link() + '<plugin name="p" filename="q"/>', ["plugin of model m"]),
        (link() + "<self_collide>true</self_collide>", ["self_collide of model m"]),
        (link("a", "<velocity_decay><linear>0.0</linear></velocity_decay>"), []),
        (link("a", collision("<empty/>", "<laser_retro>0</laser_retro>")), []),
        (
            link(
                "a",
                collision("<box/>", "<cast_shadows>true</cast_shadows>", "visual"),
            ),
            [],
        ),
        (
            link(
                "a",
                collision(
                    "<box/>",
                    "<surface><contact><ode/></contact><friction><torsional/><ode>"
                    "<mu>1</mu><mu2>2</mu2><slip1>0</slip1><slip2>1</slip2></ode>"
                    "</friction></surface>",
                ),
            ),
            [
                "contact of collision c of link a",
                "torsional of collision c of link a",
                "mu2 of collision c of link a",
                "slip2 of collision c of link a",
            ],
        ),
        (
            A_B
            + joint(
                inside="<axis><initial_position>1</initial_position><dynamics>"
                "<spring_stiffness>0</spring_stiffness></dynamics></axis>"
                "<axis2/><physics><ode/></physics>"
            ),
            [
                "axis2 of joint ab",
                "physics of joint ab",
                "initial_position of joint ab",
            ],
        ),
        (
            link()
            + model(link("b", '<sensor name="s" type="imu"/>'), name="in", static=True)
            + joint("fixed", child="in::b"),
            ["sensor of link in::b", "static of model in"],
        ),
    ],
)
def test_what_is_not_simulated_is_named_once(inside, clauses):
    told = [f"{clause} is not simulated" for clause in clauses]
    assert list(read_model(inside).assembly.left_out) == told


def test_a_world_is_read_and_the_rest_of_it_named():
    found = read_sdf(
        world(
            "<gravity>0 0 -1.6</gravity><scene/><scene/><gui/>"
            '<physics type="ode"><max_step_size>5</max_step_size></physics>'
            '<physics default="1"><max_step_size>0.002</max_step_size>'
            "<real_time_update_rate>500</real_time_update_rate><ode/><dart/></physics>"
            '<frame name="f"><pose>0 0 1 0 0 0</pose></frame>'
            + model('<pose relative_to="f">1 0 0 0 0 0</pose>' + link())
            + model("<pose>2 0 0 0 0 0</pose>" + link(), name="n", static=True)
            + '<light name="l" type="spot"><pose>3 0 0 0 0 0</pose><spot/></light>'
        )
    )
    assert found.gravity == (0.0, 0.0, -1.6)
    assert found.physics == {"time_step": 0.002, "max_update_rate": 500.0}
    assert [read.name for read in found.models] == ["m", "n"]
    assert [read.assembly.static for read in found.models] == [False, True]
    np.testing.assert_allclose(
        [r.pose[:3] for r in found.models], [[1, 0, 1], [2, 0, 0]]
    )
    assert set(found.left_out) == {
        "scene of the world is not simulated",
        "gui of the world is not simulated",
        "dart of the physics of the world is not simulated",
        "spot of light l is not simulated",
    }


def test_the_numbers_of_ode_have_the_names_of_the_service():
    """All different; what Gazebo writes beside them when it saves a world is told."""
    found = read_sdf(
        world(
            "<physics type='ode'><max_contacts>7</max_contacts><ode><solver>"
            "<type>quick</type><iters>77</iters><precon_iters>2</precon_iters>"
            "<sor>1.5</sor><friction_model>cone_model</friction_model></solver>"
            "<constraints><cfm>0.25</cfm><erp>0.3</erp><contact_surface_layer>0.002"
            "</contact_surface_layer><contact_max_correcting_vel>10"
            "</contact_max_correcting_vel></constraints></ode></physics>"
        )
    )
    assert found.physics == {
        "max_contacts": 7.0,
        "sor_pgs_precon_iters": 2.0,
        "sor_pgs_iters": 77.0,
        "sor_pgs_w": 1.5,
        "cfm": 0.25,
        "erp": 0.3,
        "contact_surface_layer": 0.002,
        "contact_max_correcting_vel": 10.0,
    }
    told = "friction_model of the physics of the world is not simulated"
    assert found.left_out == (told,)


def test_a_file_that_does_not_tell_leaves_the_world_alone():
    found = read_sdf(sdf(model(link()) + model(link(), name="second")))
    assert (found.gravity, found.physics) == (None, {})
    assert [read.name for read in found.models] == ["m"]
    told = "model second is ignored: only the first model of a file is read"
    assert found.left_out == (told,)


def test_a_light_is_kept_as_data():
    (lamp,) = read_sdf(GOLDEN_LAMP).lights
    assert (lamp.name, lamp.kind, lamp.cast_shadows) == ("lamp", "point", False)
    np.testing.assert_array_equal(lamp.pose, [1, 2, 3, 0, 0, 0, 1])
    assert lamp.diffuse == (0.5, 0.25, 0.125, 1.0)
    assert (lamp.attenuation_range, lamp.attenuation_constant) == (20.0, 0.5)
    assert (lamp.attenuation_linear, lamp.attenuation_quadratic) == (0.25, 0.125)


def test_the_empty_world_is_that_of_gazebo():
    """Numbers from Gazebo 11.1.0: shared/design/gazebo_contract.md."""
    found = read_sdf(EMPTY_WORLD)
    assert found.gravity == (0.0, 0.0, -9.8)
    assert found.physics == {"time_step": 0.001, "max_update_rate": 1000.0}
    (ground,), (sun,) = found.models, found.lights
    assert (ground.name, ground.assembly.static) == ("ground_plane", True)
    (only,) = ground.assembly.description.links
    assert (only.name, [s.name for s in only.collisions]) == ("link", ["collision"])
    assert only.collisions[0].size == (0.0, 0.0, 1.0)
    assert (sun.name, sun.diffuse) == ("sun", (0.8, 0.8, 0.8, 1.0))
    assert (sun.attenuation_constant, sun.attenuation_linear) == (0.9, 0.01)
    assert sun.attenuation_quadratic == 0.001
    assert (found.left_out, ground.assembly.left_out) == ((), ())


BOXES = {
    "model://box": sdf(model("<pose>9 9 9 0 0 0</pose>" + link(), name="box")),
    "model://pair": sdf(
        model(
            link()
            + "<include><uri>model://box</uri><name>held</name></include>"
            + joint("fixed", child="held::a"),
            name="pair",
        )
    ),
    "model://old": sdf(
        model(QUARTER_TURNED_B + joint(inside=X_AXIS.format("")), name="old"), "1.4"
    ),
    "model://itself": sdf(
        model(link() + "<include><uri>model://itself</uri></include>", name="itself")
    ),
    "model://twice": sdf(
        model(link() + "<include><uri>model://again</uri></include>", name="twice")
    ),
    "model://again": sdf(
        model(link() + "<include><uri>model://twice</uri></include>", name="again")
    ),
    "model://broken": "<sdf",
    "model://nothing": sdf("<actor/>"),
}


def find_box(uri):
    if uri not in BOXES:
        raise NoSuchModelError(f"There is no {uri} in the cellar.")
    return BOXES[uri]


def include(uri, inside=""):
    return f"<include><uri>{uri}</uri>{inside}</include>"


def test_an_include_may_rename_and_move_and_fix_a_model():
    inside = "<name>b2</name><pose>1 2 3 0 0 0</pose><static>1</static>"
    found = read_sdf(
        world(include("model://box") + include("model://box", inside)), find_box
    )
    assert [read.name for read in found.models] == ["box", "b2"]
    assert [read.assembly.static for read in found.models] == [False, True]
    np.testing.assert_allclose([r.pose[:3] for r in found.models], [[9] * 3, [1, 2, 3]])


def test_an_include_in_an_included_model_is_a_model_inside():
    (pair,) = read_sdf(world(include("model://pair")), find_box).models
    assert pair.assembly.link_names == ("a", "held::a")
    np.testing.assert_allclose(pair.assembly.description.joints[0].pose[:3], [9] * 3)


SHELVES = {
    "model://still": sdf(model(link(), name="still", static=True)),
    "model://moving": sdf(model(link(), name="moving")),
    "model://rack": sdf(model(include("model://still"), name="rack")),
    "model://inline": sdf(
        model(link() + model(link(), name="in", static=True), name="inline")
    ),
}


@pytest.mark.parametrize(
    ("inside", "static"),
    [
        (include("model://still"), True),
        (include("model://rack"), True),
        (include("model://still", "<static>0</static>"), False),
        (include("model://still") + "<static>false</static>", True),
        (
            include("model://moving", "<static>0</static>")
            + include("model://still", "<name>b</name>"),
            False,
        ),
        (include("model://inline"), False),
    ],
)
def test_an_included_model_is_as_static_as_the_model_around_it(inside, static):
    """Where that says nothing, the first included model that does counts."""
    (alone,) = read_sdf(sdf(model(inside)), SHELVES.get).models
    (found,) = read_sdf(world(model(inside)), SHELVES.get).models
    assert [alone.assembly.static, found.assembly.static] == [static, static]


def test_the_ground_and_the_sun_are_there_to_be_included():
    inside = include("model://sun") + include("model://ground_plane")
    found = read_sdf(world(inside))
    assert [read.name for read in found.models] == ["ground_plane"]
    assert [read.name for read in found.lights] == ["sun"]
    (own,) = read_sdf(world(include("model://sun")), lambda uri: GOLDEN_LAMP).lights
    assert own.name == "lamp"


def test_what_of_an_include_has_no_effect_is_named():
    inside = include("model://nowhere") + include(
        "model://box", "<placement_frame>a</placement_frame><plugin/>"
    )
    found = read_sdf(world(inside), find_box)
    assert found.left_out == (
        "include of model://nowhere is ignored: There is no model://nowhere in the "
        "cellar",
        "placement_frame of the include of model://box is ignored",
    )
    assert found.models[0].assembly.left_out == (
        "plugin of model box is not simulated",
    )


@pytest.mark.parametrize(
    ("uri", "words"),
    [
        ("model://twice", "model://twice includes itself, through .*twice and .*again"),
        ("model://broken", "SDF of model://broken is not XML"),
    ],
)
def test_a_wrong_include_is_refused_with_facts_or_left_out_of_a_world(uri, words):
    with pytest.raises(DescriptionError, match=words):
        read_sdf(sdf(model(link() + include(uri))), find_box)
    found = read_sdf(world(include(uri) + include("model://box")), find_box)
    assert "box" in [read.name for read in found.models]
    assert any(re.search(words, clause) for clause in found.left_out)


def test_includes_without_end_are_refused():
    def deeper(uri):
        return sdf(model(link() + include(uri + "x"), name="m"))

    def wider(uri):
        return sdf(model(link() + include(uri + "x") + include(uri + "y"), name="m"))

    with pytest.raises(DescriptionError, match=r"includes of model://a .* 20 deep"):
        read_sdf(sdf(model(link() + include("model://a"))), deeper)
    with pytest.raises(DescriptionError, match="more than 1000 models"):
        read_sdf(world(include("model://a")), wider)


ODD_MODELS = {
    "name good is used twice in the world": model(link(), name="good"),
    "The pose of model bad must be a number": model(
        "<pose>here</pose>" + link(), name="bad"
    ),
    "The mass of link a .*nan": model(
        link("a", "<inertial><mass>nan</mass></inertial>"), name="bad"
    ),
}


@pytest.mark.parametrize("why", ODD_MODELS)
def test_an_odd_model_is_left_out_of_a_world_with_the_reason(why):
    odd = ODD_MODELS[why]
    rest = model("<pose>0 0 1 0 0 0</pose>" + link(), name="second")
    found = read_sdf(world(model(link(), name="good") + odd + rest))
    assert [read.name for read in found.models] == ["good", "second"]
    (told,) = found.left_out
    assert re.match(f"model.* is ignored: .*{why}", told)
    (reason,) = found.refused
    assert re.search(why, reason) and told.endswith(f"is ignored: {reason[:-1]}")


@pytest.mark.parametrize("inertia", ["<ixx>nan</ixx>", "<iyy>-1</iyy>"])
def test_a_static_model_needs_no_usable_inertia(inertia):
    inside = link("a", f"<inertial><inertia>{inertia}</inertia></inertial>")
    assembly = read_model(inside, static=True).assembly
    assert assembly.link_names == ("a",)
    (told,) = assembly.left_out
    assert told.startswith("inertial of link a is ignored: The ")
    with pytest.raises(DescriptionError, match="link a"):
        read_model(inside)


def test_two_joints_on_one_child_move_as_if_one_were_turned_around():
    inside = (
        link("a")
        + link("b", "<pose>1 0 0 0 0 0</pose>")
        + link("c", "<pose>2 0 0 0 0 0.5</pose>")
        + joint("fixed", "a", "b")
        + joint("revolute", "c", "b", "<pose>0.5 0 0 0 0 0</pose>", name="cb")
    )
    assembly = read_model(inside).assembly
    assert assembly.left_out == ()
    assert assembly.description.root == "a"
    kinematics = Kinematics(assembly.description)
    poses = kinematics.link_poses(assembly.root_pose, np.array([0.7]))
    # The joint turns b in c by 0.7 about z through (1.5, 0), so c in b by -0.7.
    rest = matrix([2, 0, 0, 0, 0, 0.5])
    turn = screw("revolute", np.array([1.5, 0, 0]), np.array([0, 0, 1.0]), -0.7)
    np.testing.assert_allclose(matrix(poses[2]), turn @ rest, atol=1e-12)


@pytest.mark.parametrize(
    ("inside", "left", "kept"),
    [
        (A_B + joint() + joint(name="also"), "also", ["ab"]),
        (A_B + joint() + joint(parent="b", child="a", name="ba"), "ba", ["ab"]),
        (
            A_B
            + joint()
            + joint("fixed", "world", "a", name="wa")
            + joint("fixed", "world", "b", name="wb"),
            "wb",
            ["ab", "wa"],
        ),
        (A_B + link("c") + LOOP, "cb", ["bc"]),
    ],
)
@pytest.mark.parametrize("static", [False, True])
def test_a_joint_that_closes_a_loop_is_left_out_by_name(inside, left, kept, static):
    assembly = read_model(inside, static=static).assembly
    assert [one.name for one in assembly.description.joints if one.listed] == [
        name for name in kept if not (static and name == "wa")
    ]
    (told,) = assembly.left_out
    assert told.startswith(f"joint {left} is ignored: it closes a loop of joints")


@pytest.mark.parametrize(
    ("ends", "why"),
    [
        ({"child": "c"}, "its child c is not a link of the model"),
        ({"child": ""}, "it has no child"),
        ({"parent": "world", "child": "world"}, "both of its links are the world"),
        ({"parent": "b", "child": "b"}, "both of its links are b"),
    ],
)
@pytest.mark.parametrize("static", [False, True])
def test_a_joint_without_its_links_is_left_out_with_the_reason(ends, why, static):
    inside = A_B + link("d") + joint(**ends) + joint("fixed", child="d", name="ad")
    assembly = read_model(inside, static=static).assembly
    found = [one.name for one in assembly.description.joints if one.listed]
    assert found == ["ad"]
    assert assembly.left_out == (f"joint ab is ignored: {why}",)


@pytest.mark.parametrize("version", ["1.6", "1.7"])
def test_a_link_may_be_the_parent_of_the_world(version):
    """Gazebo fixes it; it is the world that its libsdformat complains of."""
    inside = (
        link("a", "<pose>1 2 3 0 0 0.5</pose>")
        + link("b", "<pose>0 0 4 0 0 0</pose>")
        + joint("fixed", "a", "world", "<pose>5 0 0 0 0 0</pose>", name="aw")
        + joint("revolute", "a", "b")
    )
    other = inside.replace(
        "<parent>a</parent><child>world</child><pose>5 0 0 0 0 0</pose>",
        "<parent>world</parent><child>a</child>",
    )
    assert inside != other
    found, wanted = (read_model(i, version).assembly for i in (inside, other))
    assert found.left_out == ()
    assert found.description.root == "world"
    assert [(j.name, j.kind, j.parent, j.child) for j in found.description.joints] == [
        ("aw", "fixed", "world", "a"),
        ("ab", "continuous", "a", "b"),
    ]
    poses, right = (
        Kinematics(a.description).link_poses(a.root_pose, np.array([0.3]))
        for a in (found, wanted)
    )
    np.testing.assert_allclose(poses, right, atol=1e-12)


@pytest.mark.parametrize("kind", ["universal", ""])
def test_a_joint_that_is_not_simulated_holds_its_links_together(kind):
    inside = A_B + link("c") + joint(kind) + joint("revolute", "b", "c", name="bc")
    assembly = read_model(inside).assembly
    assert [
        (one.name, one.kind, one.listed) for one in assembly.description.joints
    ] == [("ab", "fixed", False), ("bc", "continuous", True)]
    told = f"joint ab is {kind or 'of no type'}, which is not simulated"
    assert assembly.left_out == (f"{told}: b is fixed to a",)


WHOLE = world(
    "<gravity>0 0 -9.8</gravity><physics><max_step_size>0.1</max_step_size></physics>"
    '<frame name="f"><pose>1 2 3 0 0 0</pose></frame><light name="l"><diffuse>1 1 1'
    "</diffuse><attenuation><range>1</range></attenuation></light>"
    + include("model://box", "<name>other</name><pose>1 2 3 0 0 0</pose>")
    + model(
        '<pose relative_to="f">1 0 0 0 0 0</pose>'
        + link("a", collision("<box><size>1 2 3</size></box>"))
        + link(
            "b", "<inertial><mass>1</mass><inertia><ixx>1</ixx></inertia></inertial>"
        )
        + joint(inside='<axis><xyz expressed_in="a">1 0 0</xyz></axis>')
        + model(link("c"), name="inner")
        + joint("prismatic", "b", "inner::c", LIMIT.format("<upper>1</upper>"), "bc")
    )
)
JUNK = st.sampled_from(
    ["", " ", "nan", "-inf", "1e999", "a", "b", "world", "1 2", "-1"]
)


@settings(max_examples=30)
@given(
    st.integers(0, 200),
    st.sampled_from(["text", "tag", "attribute", "remove", "repeat"]),
    JUNK,
)
def test_a_damaged_file_is_read_or_refused_and_nothing_else(place, damage, junk):
    assert read_sdf(WHOLE, find_box).left_out == ()
    root = etree.fromstring(WHOLE)
    elements = list(root.iter())
    element = elements[1 + place % (len(elements) - 1)]
    parent = element.getparent()
    if damage == "text":
        element.text = junk
    elif damage == "tag":
        element.tag = junk.strip().replace(" ", "_").lstrip("-1") or "x"
    elif damage == "attribute":
        for name in element.keys() or ["name"]:
            element.set(name, junk)
    elif damage == "remove":
        parent.remove(element)
    else:
        parent.append(etree.fromstring(etree.tostring(element)))
    try:
        read_sdf(etree.tostring(root, encoding="unicode"), find_box)
    except DescriptionError as error:
        assert str(error).endswith(".")
