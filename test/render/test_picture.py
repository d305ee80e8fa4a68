"""Pictures: what they show, held against projections computed otherwise."""

import os
import subprocess
import sys
import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pytest
import trimesh
from conftest import REPOSITORY
from oracle import forward_kinematics
from scipy.spatial.transform import Rotation

from g1_description.render.camera import VIEWS, Camera, framing
from g1_description.render.rasterizer import NOTHING, nearest, touching
from g1_description.render.scene import Picture, draw, silhouette
from g1_description.robot.urdf import parse_urdf
from g1_description.scenes.scene import Scene

MIDDLE = np.array([0.0, 0.0, 0.66])
OURS = REPOSITORY / "urdf" / "g1_29dof.urdf"
PACKAGE = "package://g1_description"
LOOKED_AT = ("head_link", "torso_link")
SOURCE = Path(__file__).resolve().parents[2] / "src"


def at(x=0.0, y=0.0, z=0.0):
    return np.array([x, y, z, 0.0, 0.0, 0.0, 1.0])


STANDING = at(z=0.793)


def body(geometry, xyz="0 0 0", color=None, name="shape"):
    """Write a robot of one link with one visual shape."""
    material = f'<material name="m"><color rgba="{color}"/></material>' if color else ""
    return parse_urdf(
        f'<robot name="{name}"><link name="{name}"><visual><origin xyz="{xyz}"/>'
        f"<geometry>{geometry}</geometry>{material}</visual></link></robot>"
    )


@pytest.fixture
def scene():
    made = Picture()
    yield made


@pytest.fixture(scope="module")
def g1_scene():
    """Give a scene of a G1, which tests place before they look at it."""
    made = Picture()
    made.add(parse_urdf(OURS.read_text()))
    yield made


def area(mask, camera):
    """Measure what a mask covers at the target, in [m^2]."""
    return (mask != NOTHING).sum() * (camera.width / mask.shape[1]) ** 2


SHAPES = {
    '<sphere radius="0.5"/>': lambda direction: np.pi * 0.25,
    '<box size="0.4 0.6 0.8"/>': lambda direction: (
        np.abs(direction) @ [0.6 * 0.8, 0.4 * 0.8, 0.4 * 0.6]
    ),
    '<capsule radius="0.3" length="0.7"/>': lambda direction: (
        0.42 * np.hypot(*direction[:2]) + np.pi * 0.09
    ),
    '<cylinder radius="0.3" length="1"/>': lambda direction: (
        0.6 * np.hypot(*direction[:2]) + np.pi * 0.09 * abs(direction[2])
    ),
}


@pytest.mark.parametrize("angles", [(0.7, 0.4), (-2.0, -1.0)])
@pytest.mark.parametrize("geometry", SHAPES)
def test_an_orthographic_outline_has_the_area_of_the_projection(
    scene, geometry, angles
):
    scene.add(body(geometry))
    camera = Camera(np.array([0.1, 0.0, 0.05]), *angles, width=2.0)
    direction = Rotation.from_euler("yz", [-angles[1], angles[0]]).apply([1, 0, 0])
    expected = SHAPES[geometry](direction)
    mask = silhouette(scene, camera, 480, 360)
    assert area(mask, camera) == pytest.approx(expected, rel=0.01)


def test_the_nearest_triangle_is_seen_however_many_there_are():
    """A ray through each pixel's centre is the oracle."""
    rng = np.random.default_rng(1)
    corners = rng.uniform([-8, -8, 1], [48, 40, 2], (1000, 3, 3))
    corners[::7, 1:] = corners[::7, :1] + rng.normal(scale=0.7, size=(143, 2, 3))
    some = touching(corners.T, 32, 40)
    seen = np.append(some, NOTHING)[nearest(corners.T[:, :, some], 32, 40)]
    system = np.linalg.inv(np.insert(corners[:, :, :2], 2, 1.0, axis=2))
    for row, column in np.ndindex(seen.shape):
        weights = np.array([column, row, 1.0]) @ system
        near = np.where(
            (weights >= 0.0).all(axis=1), (weights * corners[..., 2]).sum(1), 0
        )
        assert seen[row, column] == (near.argmax() if near.any() else NOTHING)


def test_triangles_that_meet_at_the_centres_of_pixels_leave_no_gap():
    x, y = np.meshgrid(np.arange(0.0, 41.0, 4.0), np.arange(0.0, 33.0, 4.0))
    n = np.arange(x.size).reshape(x.shape)
    upper = np.stack([n[:-1, :-1], n[:-1, 1:], n[1:, :-1]], axis=-1).reshape(-1, 3)
    lower = np.stack([n[1:, 1:], n[1:, :-1], n[:-1, 1:]], axis=-1).reshape(-1, 3)
    places = np.stack([x, y, np.ones_like(x)]).reshape(3, -1)
    corners = places[:, np.concatenate([upper, lower]).T]
    corners[:2] += np.random.default_rng(1).normal(scale=1e-12, size=corners[:2].shape)
    assert (nearest(corners, 33, 41) != NOTHING).all()


def test_a_perspective_outline_has_the_area_of_the_cone(scene):
    """The lines of sight that touch a sphere make a cone about the middle."""
    distance = 1.5
    scene.add(body('<sphere radius="0.5"/>'))
    camera = Camera(np.zeros(3), 0.3, 0.2, width=2.0, distance=distance)
    expected = np.pi * 0.25 / (1.0 - 0.25 / distance**2)
    mask = silhouette(scene, camera, 400, 400)
    assert area(mask, camera) == pytest.approx(expected, rel=0.01)


def test_the_part_that_is_drawn_changes_nothing(scene):
    """A body on one side is seen where it is, to the pixel."""
    scene.add(body('<box size="0.2 0.2 0.2"/>', "0 0.5 0.3"))
    mask = silhouette(scene, Camera(np.zeros(3), 0.0, 0.0, width=2.0), 400, 300)
    rows, columns = np.nonzero(mask != NOTHING)
    assert (columns.min(), columns.max() + 1) == (280, 320)
    assert (rows.min(), rows.max() + 1) == (70, 110)


def test_what_is_outside_the_picture_is_not_drawn(scene):
    scene.add(body('<box size="0.2 0.2 0.2"/>', "0 5 0"))
    camera = Camera(np.zeros(3), 0.0, 0.0, width=2.0)
    assert (silhouette(scene, camera, 80, 60) == NOTHING).all()
    assert draw(scene, camera, 80, 60).shape == (60, 80, 3)


@pytest.mark.parametrize(
    ("name", "place", "right"),
    [
        ("front", "0 0.5 0.5", True),
        ("back", "0 0.5 0.5", False),
        ("side", "0.5 0 0.5", True),
        ("iso", "0 0.5 0.5", True),
    ],
)
def test_up_is_up_and_views_are_not_mirrored(scene, name, place, right):
    """The robot's left hand is on the right of the picture of its front."""
    scene.add(body('<box size="0.1 0.1 0.1"/>', place))
    mask = silhouette(scene, Camera(np.zeros(3), *VIEWS[name], width=2.0), 200, 200)
    rows, columns = np.nonzero(mask != NOTHING)
    assert columns.size
    assert (rows < 100).all()
    assert (columns > 100).all() if right else (columns < 100).all()


@pytest.mark.slow
@pytest.mark.parametrize("angles", [VIEWS["side"], VIEWS["iso"]])
def test_the_robot_fills_the_picture_but_for_a_margin(g1_scene, angles):
    width, height = (480, 360) if angles[1] else (200, 400)
    g1_scene.place(0, STANDING, {"left_shoulder_roll_joint": 1.0})
    camera = framing(g1_scene.corners(), *angles, width / height)
    rows, columns = np.nonzero(silhouette(g1_scene, camera, width, height) != NOTHING)
    margins = (
        np.array([rows.min(), height - 1 - rows.max()]) / height,
        np.array([columns.min(), width - 1 - columns.max()]) / width,
    )
    assert min(margins[0].min(), margins[1].min()) > 0.05
    assert min(margins[0].max(), margins[1].max()) < 0.2


def test_our_g1_is_whole_and_has_a_dark_head(scene):
    """Where its meshes are is told by trimesh and scipy."""
    text = OURS.read_text()
    scene.add(parse_urdf(text))
    scene.place(0, STANDING, {})
    camera = framing(scene.corners(), *VIEWS["iso"], 3 / 4)
    points = corners_of_meshes(text)
    seen = camera.seen(np.concatenate([*points.values()]))
    assert (np.abs(seen) < [0.5, 0.5 * 4 / 3]).all()
    outline = seen * [300, -300] + [150, 200]
    robot = silhouette(scene, camera, 300, 400) != NOTHING
    rows, columns = np.nonzero(robot)
    edges = np.array([columns.min(), rows.min(), columns.max() + 1, rows.max() + 1])
    expected = np.concatenate([outline.min(axis=0), outline.max(axis=0)])
    np.testing.assert_allclose(edges, expected, atol=1.5)
    picture = draw(scene, camera, 300, 400)
    places = [around(camera.seen(points[link])) for link in LOOKED_AT]
    head, torso = (picture[place][robot[place]].mean() for place in places)
    assert head < torso - 50


def around(seen):
    """Give the pixels of 300 x 400 in the middle half of what is seen somewhere."""
    low, high = np.percentile(seen * [300, -300] + [150, 200], [0, 100], axis=0)
    left, top = np.ceil(low + (high - low) / 4).astype(int)
    right, bottom = np.floor(high - (high - low) / 4).astype(int)
    return slice(top, bottom), slice(left, right)


def corners_of_meshes(text):
    """Place what the meshes of a standing robot are made of, by link."""
    poses = forward_kinematics(text, STANDING, {})
    points = {}
    for link in ET.fromstring(text).findall("link"):
        for mesh in link.findall("visual/geometry/mesh"):
            file = mesh.get("filename").replace(
                "package://g1_description", str(REPOSITORY)
            )
            vertices = trimesh.load(file).vertices
            pose = poses[link.get("name")]
            turned = Rotation.from_quat(pose[3:]).apply(vertices)
            points[link.get("name")] = pose[:3] + turned
    return points


def test_only_what_hangs_on_a_joint_changes(g1_scene):
    camera = Camera(MIDDLE, 0.0, 0.0, width=2.0, distance=4.0)
    pictures, masks = [], []
    for position in (0.0, 1.2):
        g1_scene.place(0, STANDING, {"left_shoulder_roll_joint": position})
        pictures.append(draw(g1_scene, camera, 320, 320).astype(int))
        masks.append(silhouette(g1_scene, camera, 320, 320))
    changed = np.abs(pictures[1] - pictures[0]).max(axis=2)
    above_the_floor = slice(0, 190)  # below it is the shadow
    assert not changed[above_the_floor, :160].any()
    assert (changed[above_the_floor, 160:] > 20).sum() > 500
    assert (masks[0] != masks[1])[:, 160:].any()
    assert (masks[0] == masks[1])[:, :160].all()


def test_the_colour_of_a_material_comes_through(scene):
    """Also where the link only names a material of the robot."""
    named = (
        '<robot name="r"><material name="sea"><color rgba="0 0.25 0.5 1"/></material>'
        '<link name="a"><visual><geometry><box size="1 1 1"/></geometry>'
        '<material name="sea"/></visual></link></robot>'
    )
    camera = Camera(np.zeros(3), 0.0, 0.0, width=2.0)
    for number, description in enumerate(
        [parse_urdf(named), body('<sphere radius="0.6"/>', color="0.8 0.4 0.2 1")]
    ):
        scene.add(description)
        scene.place(number, at(x=number), {})
        seen = draw(scene, camera, 40, 40)[20, 20] / 255.0
        wanted = np.array([[0.0, 0.25, 0.5], [0.8, 0.4, 0.2]][number])
        shade = seen @ wanted / (wanted @ wanted)
        np.testing.assert_allclose(seen, shade * wanted, atol=0.05)
        assert 0.7 < shade < 1.3


def test_robots_are_told_apart_and_placed(scene):
    for _ in range(2):
        scene.add(body('<box size="0.2 0.2 0.2"/>'))
    scene.place(1, at(y=0.5), {})
    mask = silhouette(scene, Camera(np.zeros(3), 0.0, 0.0, width=2.0), 200, 200)
    assert (mask[100, 100], mask[100, 150], mask[100, 50]) == (0, 1, NOTHING)


def test_objects_are_drawn_as_robots_are():
    geometry = '<box size="0.2 0.3 0.1"/>'
    camera, objects, pictures = Camera(np.zeros(3), 0.3, 0.4, width=2.0), Scene(), []
    objects.box("box", [0.2, 0.3, 0.1], [5, 0, 0], color=[0.8, 0.4, 0.2])
    objects.plane("wall", [1, 0, 0], [0, 0, 0])
    one, other = Picture(), Picture()
    one.add(body('<sphere radius="0.1"/>'))
    other.add(body('<sphere radius="0.1"/>'))
    one.add(body(geometry, color="0.8 0.4 0.2 1"))
    group, left_out = other.add_objects([*objects.values()])
    assert left_out == ()
    # What is far off is in the picture, but a camera does not turn to it.
    np.testing.assert_allclose(np.abs(other.subject()).max(), 0.1)
    pose = at(y=0.4)
    one.place(1, pose, {})
    other.move(group, {"box": pose})
    np.testing.assert_allclose(other.subject(), one.corners())
    pictures = [draw(scene, camera, 60, 60) for scene in (one, other)]
    np.testing.assert_array_equal(*pictures)


def test_the_shadow_falls_on_the_floor_and_away_from_the_lamp(scene):
    camera = Camera(np.zeros(3), 0.0, 0.5, width=2.0)
    empty = draw(scene, camera, 200, 200, floor=-0.3).astype(int)
    scene.add(body('<sphere radius="0.2"/>'))
    picture = draw(scene, camera, 200, 200, floor=-0.3).astype(int)
    darker = (empty - picture).min(axis=2) > 15
    darker &= silhouette(scene, camera, 200, 200) == NOTHING
    columns = np.nonzero(darker)[1]
    assert darker.sum() > 200
    assert columns.mean() > 110


def test_a_mesh_that_is_missing_is_named(scene):
    robot = body('<mesh filename="package://nowhere/a.stl"/>')
    assert scene.add(robot) == (
        0,
        ("mesh package://nowhere/a.stl does not exist",),
    )
    assert scene.corners().shape == (0, 3)


def test_links_without_mass_and_on_fixed_joints_are_seen(scene):
    robot = parse_urdf(
        '<robot name="r"><link name="a"/><link name="b"><visual>'
        '<geometry><box size="0.2 0.2 0.2"/></geometry></visual></link>'
        '<joint name="j" type="fixed"><parent link="a"/><child link="b"/>'
        '<origin xyz="0 0.5 0"/></joint></robot>'
    )
    scene.add(robot)
    mask = silhouette(scene, Camera(np.zeros(3), 0.0, 0.0, width=2.0), 200, 200)
    assert mask[100, 150] == 0


def test_no_screen_is_needed():
    code = (
        "import numpy as np\n"
        "from g1_description.render.camera import Camera\n"
        "from g1_description.render.scene import draw\n"
        "from g1_description.render.scene import Picture\n"
        "draw(Picture(), Camera(np.zeros(3), 0.0, 0.0, 1.0), 16, 16)\n"
    )
    path = os.pathsep.join([str(SOURCE), *sys.path])
    environment = {**os.environ, "PYTHONPATH": path}
    environment.pop("DISPLAY", None)
    subprocess.run([sys.executable, "-c", code], env=environment, check=True)
