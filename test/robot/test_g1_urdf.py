"""Hold the robot's description against its figures and against itself."""

import shutil
import subprocess
import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pytest
import trimesh
import yaml
from scipy.spatial.transform import Rotation
from waiting import DEADLINE

REPOSITORY = Path(__file__).resolve().parents[2]
URDF = REPOSITORY / "urdf" / "g1_29dof.urdf"
TABLE = REPOSITORY.parent / "shared" / "data" / "g1_29dof_figures.yaml"
ROBOT = ET.parse(str(URDF)).getroot()
LINKS = {link.get("name"): link for link in ROBOT.findall("link")}
JOINTS = {joint.get("name"): joint for joint in ROBOT.findall("joint")}
REVOLUTE = [name for name, joint in JOINTS.items() if joint.get("type") == "revolute"]
LEFT = [name for name in REVOLUTE if name.startswith("left_")]
MIRROR_Y = np.array([1.0, -1.0, 1.0])
MIRROR_RPY = np.array([-1.0, 1.0, -1.0])


def numbers(text):
    return [float(word) for word in text.split()]


def origin(element):
    """Position in [m] and roll, pitch, yaw in [rad]."""
    found = element.find("origin")
    if found is None:
        return [0.0, 0.0, 0.0], [0.0, 0.0, 0.0]
    return numbers(found.get("xyz")), numbers(found.get("rpy"))


def limits(joint):
    return {key: float(value) for key, value in joint.find("limit").attrib.items()}


def right_of(name):
    return name.replace("left_", "right_")


def primitive(element):
    return element.find("geometry")[0]


def link_poses():
    """Rotation and position of each link in the pelvis frame, all joints at zero."""
    poses = {"pelvis": (Rotation.from_euler("xyz", [0, 0, 0]), np.zeros(3))}
    for joint in JOINTS.values():
        rotation, position = poses[joint.find("parent").get("link")]
        xyz, rpy = origin(joint)
        poses[joint.find("child").get("link")] = (
            rotation * Rotation.from_euler("xyz", rpy),
            position + rotation.apply(xyz),
        )
    return poses


def corners(shape):
    """Points that a shape is the hull of, or lies between, in [m], shape (n, 3)."""
    if shape.tag == "mesh":
        return mesh_of(shape.get("filename")).vertices
    size = {key: np.array(numbers(value)) for key, value in shape.attrib.items()}
    if shape.tag == "sphere":
        return trimesh.creation.icosphere(4, size["radius"][0]).vertices
    return trimesh.creation.cylinder(size["radius"][0], size["length"][0]).vertices


def mesh_of(uri):
    """Load a mesh of this package."""
    scheme = "package://g1_description/"
    assert uri.startswith(scheme)
    return trimesh.load(REPOSITORY / uri[len(scheme) :])


def bounds(elements, rotation, position):
    """Box around shapes of one link whose pose is given, in [m], shape (2, 3)."""
    points = []
    for element in elements:
        xyz, rpy = origin(element)
        here = Rotation.from_euler("xyz", rpy).apply(corners(primitive(element))) + xyz
        points.append(rotation.apply(here) + position)
    points = np.concatenate(points)
    return np.array([points.min(axis=0), points.max(axis=0)])


def robot_bounds(tag):
    """Box around all shapes of one kind in the pelvis frame, all joints at zero."""
    poses = link_poses()
    boxes = [
        bounds(link.findall(tag), *poses[name])
        for name, link in LINKS.items()
        if link.find(tag) is not None
    ]
    return np.array([np.min(boxes, axis=0)[0], np.max(boxes, axis=0)[1]])


@pytest.fixture(scope="module")
def table():
    """Figures of the robot, where they lie beside the repository."""
    if not TABLE.exists():
        pytest.skip(f"{TABLE} is not there")
    return yaml.safe_load(TABLE.read_text())


def described_joint(joint):
    xyz, rpy = origin(joint)
    described = {
        "type": joint.get("type"),
        "parent": joint.find("parent").get("link"),
        "child": joint.find("child").get("link"),
        "xyz": xyz,
        "rpy": rpy,
    }
    if joint.get("type") != "fixed":
        described["axis"] = numbers(joint.find("axis").get("xyz"))
        described["limit"] = limits(joint)
    return described


def described_inertial(link):
    inertial = link.find("inertial")
    if inertial is None:
        return None
    xyz, rpy = origin(inertial)
    inertia = inertial.find("inertia").attrib
    return {
        "mass": float(inertial.find("mass").get("value")),
        "com_xyz": xyz,
        "com_rpy": rpy,
        "inertia": {key: float(value) for key, value in inertia.items()},
    }


def described_shape(collision):
    xyz, rpy = origin(collision)
    shape = primitive(collision)
    sizes = {key: float(value) for key, value in shape.attrib.items()}
    return {"shape": shape.tag, "xyz": xyz, "rpy": rpy, **sizes}


def tabulated(table, key):
    """Links of the table that have an entry, with that entry."""
    return {name: link[key] for name, link in table["links"].items() if key in link}


def test_joints_and_links_come_in_the_order_of_the_table(table):
    assert ROBOT.get("name") == table["robot"]
    assert list(JOINTS) == list(table["joints"])
    assert list(LINKS) == list(table["links"])


@pytest.mark.parametrize("name", JOINTS)
def test_every_figure_of_a_joint_is_that_of_the_table(name, table):
    assert described_joint(JOINTS[name]) == table["joints"][name]


@pytest.mark.parametrize("name", LINKS)
def test_every_figure_of_an_inertial_is_that_of_the_table(name, table):
    assert described_inertial(LINKS[name]) == table["links"][name].get("inertial")


def test_links_collide_exactly_where_the_table_says_so(table):
    colliding = {name for name, link in LINKS.items() if link.findall("collision")}
    assert colliding == set(tabulated(table, "collision"))


def test_tabulated_primitives_are_the_collision_shapes(table):
    expected = {
        name: shapes
        for name, shapes in tabulated(table, "collision").items()
        if not any("hull" in shape["shape"] for shape in shapes)
    }
    assert expected
    for name, shapes in expected.items():
        assert [described_shape(c) for c in LINKS[name].findall("collision")] == shapes


def test_visual_shapes_have_the_colours_of_the_table(table):
    colours = {
        name: {visual.find("material").get("name") for visual in link.findall("visual")}
        for name, link in LINKS.items()
    }
    expected = tabulated(table, "visual")
    for name, found in colours.items():
        assert found == ({expected[name]["color"]} if name in expected else set())


@pytest.mark.parametrize("tag", ["visual", "collision"])
def test_shapes_stay_within_the_measured_box_of_their_link(tag, table):
    level = Rotation.from_euler("xyz", [0, 0, 0])
    for name, visual in tabulated(table, "visual").items():
        shapes = LINKS[name].findall(tag)
        if not shapes:
            continue
        lower, upper = bounds(shapes, level, np.zeros(3))
        assert np.all(lower >= np.array(visual["aabb_min"]) - 2e-3), name
        assert np.all(upper <= np.array(visual["aabb_max"]) + 2e-3), name


def test_there_are_29_revolute_joints_and_all_others_are_fixed():
    assert len(REVOLUTE) == 29
    assert {joint.get("type") for joint in JOINTS.values()} == {"revolute", "fixed"}


def test_the_masses_add_up_to_35_115_kg():
    masses = [float(mass.get("value")) for mass in ROBOT.iter("mass")]
    assert sum(masses) == pytest.approx(35.115142, abs=1e-6)


def test_four_sensor_frames_have_neither_mass_nor_shape():
    empty = [name for name, link in LINKS.items() if len(link) == 0]
    assert empty == ["imu_in_torso", "imu_in_pelvis", "d435_link", "mid360_link"]


def test_joints_come_in_thirteen_pairs():
    assert len(LEFT) == 13
    rights = [name for name in REVOLUTE if name.startswith("right_")]
    assert rights == [right_of(name) for name in LEFT]


@pytest.mark.parametrize("name", LEFT)
def test_the_right_joint_sits_where_a_mirror_shows_the_left_one(name):
    xyz, rpy = map(np.array, origin(JOINTS[name]))
    right_xyz, right_rpy = map(np.array, origin(JOINTS[right_of(name)]))
    # The vendor's shoulders are at y = 0.10022 and y = -0.10021.
    tolerance = 1.1e-5 if "shoulder_pitch" in name else 0.0
    np.testing.assert_allclose(right_xyz, xyz * MIRROR_Y, rtol=0, atol=tolerance)
    np.testing.assert_array_equal(right_rpy, rpy * MIRROR_RPY)


@pytest.mark.parametrize("name", LEFT)
def test_roll_and_yaw_limits_swap_sides_and_pitch_limits_do_not(name):
    left, right = limits(JOINTS[name]), limits(JOINTS[right_of(name)])
    axis = numbers(JOINTS[name].find("axis").get("xyz"))
    assert axis == numbers(JOINTS[right_of(name)].find("axis").get("xyz"))
    if axis != [0, 1, 0]:
        left["lower"], left["upper"] = -left["upper"], -left["lower"]
    assert right == left


def test_masses_and_inertias_are_mirrored():
    for name in LINKS:
        if name.startswith("left_"):
            left = described_inertial(LINKS[name])
            right = described_inertial(LINKS[right_of(name)])
            left["com_xyz"][1] *= -1
            left["inertia"]["ixy"] *= -1
            left["inertia"]["iyz"] *= -1
            if name == "left_knee_link":  # the vendor's knees differ in this sign too
                left["inertia"]["ixz"] *= -1
            assert right == left, name


# The vendor's contact spheres end 0.4 mm above the sole, so that a pelvis at
# 0.793 m stands just above the floor with either.
@pytest.mark.parametrize(
    ("tag", "depth"), [("collision", 0.79186), ("visual", 0.79226)]
)
def test_the_soles_are_a_millimetre_above_the_floor_at_0_793(tag, depth):
    lowest = robot_bounds(tag)[0, 2]
    assert lowest == pytest.approx(-depth, abs=2e-4)
    assert 0 <= 0.793 + lowest < 1.2e-3


def test_both_soles_are_flat():
    poses = link_poses()
    for side in ("left", "right"):
        name = f"{side}_ankle_roll_link"
        rotation, position = poses[name]
        assert np.allclose(rotation.apply([0, 0, 1]), [0, 0, 1], atol=1e-9)
        contacts = [
            bounds([shape], rotation, position)[0, 2]
            for shape in LINKS[name].findall("collision")
        ]
        assert len(contacts) == 4
        assert np.ptp(contacts) < 1e-9


def test_the_robot_is_1_32_m_high():
    lower, upper = robot_bounds("visual")
    assert upper[2] - lower[2] == pytest.approx(1.32, abs=0.01)


def test_the_file_is_ascii_and_needs_its_meshes_only():
    URDF.read_bytes().decode("ascii")
    tags = {element.tag for element in ROBOT.iter()}
    assert not tags & {"texture", "gazebo", "transmission"}
    shapes = {shape.tag for geometry in ROBOT.iter("geometry") for shape in geometry}
    assert shapes == {"mesh", "cylinder", "sphere"}


def test_check_urdf_accepts_the_file():
    program = shutil.which("check_urdf")
    if program is None:
        pytest.skip("check_urdf is not installed")
    done = subprocess.run(
        [program, str(URDF)], check=False, stdout=subprocess.PIPE, timeout=DEADLINE
    )
    assert done.returncode == 0
    assert b"robot name is: g1_29dof" in done.stdout
