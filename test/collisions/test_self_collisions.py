"""Collisions of robots with themselves: against geometry, and against hpp-fcl."""

import io
import subprocess
import sys
from dataclasses import fields
from itertools import combinations

import numpy as np
import pytest
from oracle import matrix_of
from robots import link
from scipy.optimize import nnls
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation

from g1_description import Robot
from g1_description.collisions.allowed_pairs import USER, AllowedPair, AllowedPairs
from g1_description.collisions.closest_points import ClosestPoints
from g1_description.collisions.convex_shapes import (
    ConvexShape,
    Separation,
    ShapePairs,
    axes_of,
)
from g1_description.collisions.find_pairs import adjacent_pairs, random_poses
from g1_description.collisions.self_collisions import SelfCollisions
from g1_description.errors import AllowedPairsError, InvalidValueError
from g1_description.robot.rotation import rotate
from g1_description.robot.transform import IDENTITY
from g1_description.robot.urdf import parse_urdf
from g1_description.sim.meshes.hulls import outline
from g1_description.sim.meshes.shapes import find_meshes

TOUCHING = 1e-3  # [m] two engines may differ this much about touching
SMALL = 2e-5  # [m]: PyBullet's iterations end there


def robot(*links, joint="floating"):
    """Make a robot of links, each on the first."""
    names = [f"l{number}" for number in range(len(links))]
    joints = "".join(
        f'<joint name="j{name}" type="{joint}"><parent link="l0"/>'
        f'<child link="{name}"/></joint>'
        for name in names[1:]
    )
    bodies = "".join(link(name, inside) for name, inside in zip(names, links))
    return parse_urdf(f'<robot name="r">{bodies}{joints}</robot>')


def shape(geometry, xyz="0 0 0", kind="collision"):
    """Write a shape of a link."""
    return f'<{kind}><origin xyz="{xyz}"/><geometry><{geometry}/></geometry></{kind}>'


def sphere(radius, **kwargs):
    return shape(f'sphere radius="{radius}"', **kwargs)


def box(x, y, z, **kwargs):
    return shape(f'box size="{x} {y} {z}"', **kwargs)


def at(*rows):
    """Make poses of one configuration, upright where nothing else is said."""
    return np.array([[[*row, *IDENTITY[len(row) :]] for row in rows]])


def only(contacts):
    """Give the one contact: distance, points of both and normal."""
    assert len(contacts.sample) == 1
    parts = (contacts.distance, contacts.points_a, contacts.points_b, contacts.normal)
    return [part[0] for part in parts]


def same(first, second):
    """Return whether contacts agree to the last bit."""
    return all(
        np.array_equal(getattr(first, part.name), getattr(second, part.name))
        for part in fields(first)
    )


@pytest.mark.parametrize("gap", [-0.15, -0.02, 0.01])
def test_spheres(gap):
    spheres = SelfCollisions(robot(sphere(0.2), sphere(0.1)), ())
    way = np.array([2.0, -1.0, 2.0]) / 3.0
    center = np.array([5.0, 6.0, 7.0])
    poses = at(center, center + (0.3 + gap) * way)
    distance, point_a, point_b, normal = only(spheres.contacts(poses, 0.02))
    assert distance == pytest.approx(gap, abs=SMALL)
    assert normal == pytest.approx(way, abs=1e-6)
    assert point_a == pytest.approx(center + 0.2 * way, abs=SMALL)
    assert point_b == pytest.approx(center + (0.2 + gap) * way, abs=SMALL)
    assert len(spheres.contacts(poses, min(gap, 0.0) - 1e-3).sample) == 0


@pytest.mark.parametrize("gap", [-0.06, -0.01, 0.01])
def test_capsules(gap):
    """Crossing each other off their middles, in a turned world, and before a box."""
    lying = '<origin xyz="0.1 0 0" rpy="0 1.5707963267948966 0"/>'
    pill = shape('capsule radius="0.05" length="0.6"', xyz="0 0 0.2")
    across = pill.replace('<origin xyz="0 0 0.2"/>', lying).replace("0.05", "0.03")
    robots = SelfCollisions(robot(pill, across, box(1, 1, 1)), ())
    turned = Rotation.from_euler("xyz", [0.3, -1.0, 2.0])
    q = turned.as_quat()
    beside = turned.apply([0.05, 0.08 + gap, 0.3])
    under = turned.apply([0.0, 0.0, -0.1 - 0.05 - gap - 0.5])
    poses = at([0, 0, 0, *q], [*beside, *q], [*under, *q])
    found = robots.contacts(poses, 0.02)
    assert [robots.pairs[pair] for pair in found.pair] == [("l0", "l1"), ("l0", "l2")]
    assert found.distance == pytest.approx([gap, gap], abs=SMALL)
    normals = turned.apply([[0, 1, 0], [0, 0, -1]])
    assert found.normal == pytest.approx(normals, abs=1e-3)
    points = turned.apply([[0, 0.05, 0.3], [0, 0, -0.15]])
    assert found.points_a == pytest.approx(points, abs=1e-4)


def test_boxes():
    """Least overlap along y, seen in a turned world."""
    boxes = SelfCollisions(robot(box(1, 1, 1), box(1, 2, 1)), ())
    turned = Rotation.from_euler("xyz", [0.3, -1.0, 2.0])
    q = turned.as_quat()
    offset = turned.apply([0.3, 1.5 - 0.05, -0.4])
    poses = at([0.0, 0.0, 0.0, *q], [*offset, *q])
    distance, point_a, point_b, normal = only(boxes.contacts(poses))
    assert distance == pytest.approx(-0.05, abs=SMALL)
    assert normal == pytest.approx(turned.apply([0.0, 1.0, 0.0]), abs=1e-4)
    assert turned.inv().apply(point_a)[1] == pytest.approx(0.5, abs=SMALL)
    assert turned.inv().apply(point_b)[1] == pytest.approx(0.45, abs=SMALL)
    x, _, z = turned.inv().apply(point_a)
    assert -0.2 - SMALL <= x <= 0.5 + SMALL and -0.9 - SMALL <= z <= 0.1 + SMALL


def test_a_sphere_in_a_box_and_a_cylinder_beside():
    cylinder = shape('cylinder radius="0.1" length="0.4"')
    robots = SelfCollisions(robot(box(1, 1, 1), sphere(0.1), cylinder), ())
    poses = at([0, 0, 0], [0.45, 0.1, 0.2], [0, 0, 0.69])
    found = robots.contacts(poses)
    assert [robots.pairs[pair] for pair in found.pair] == [("l0", "l1"), ("l0", "l2")]
    assert found.distance == pytest.approx([-0.15, -0.01], abs=SMALL)
    assert found.normal[0] == pytest.approx([1, 0, 0], abs=1e-4)
    assert found.normal[1] == pytest.approx([0, 0, 1], abs=1e-4)
    assert found.points_a[0] == pytest.approx([0.5, 0.1, 0.2], abs=SMALL)


def test_of_several_shapes_the_deepest_counts():
    two = sphere(0.1, xyz="0 0 0") + sphere(0.1, xyz="0.05 0 0")
    spheres = SelfCollisions(robot(sphere(0.1), two), ())
    distance, *_ = only(spheres.contacts(at([0, 0, 0], [-0.1, 0, 0])))
    assert distance == pytest.approx(-0.15, abs=SMALL)


def test_fixed_links_and_allowed_pairs_are_not_checked():
    fixed = robot(sphere(0.1), sphere(0.1), joint="fixed")
    assert SelfCollisions(fixed, ()).pairs == ()
    assert len(SelfCollisions(fixed, ()).contacts(at([0, 0, 0], [0, 0, 0])).sample) == 0
    loose = robot(*[sphere(0.1)] * 3)
    allowed = [AllowedPair("l2", "l0", USER)]
    assert SelfCollisions(loose, allowed).pairs == (("l0", "l1"), ("l1", "l2"))


def test_of_some_pairs_only_these_are_found():
    spheres = SelfCollisions(robot(*[sphere(0.1)] * 3), ())
    poses = at([0, 0, 0], [0, 0, 0.1], [0, 0.1, 0])
    assert spheres.contacts(poses).pair.tolist() == [0, 1, 2]
    assert spheres.contacts(poses, pairs=[1, 2]).pair.tolist() == [1, 2]
    assert spheres.contacts(poses, pairs=[]).pair.tolist() == []


def test_links_without_collisions():
    links = [sphere(0.1), sphere(0.1, kind="visual"), ""]
    loose = robot(*links)
    with_visuals = SelfCollisions(loose, ())
    assert with_visuals.links == ("l0", "l1")
    without = SelfCollisions(loose, (), visual_hulls=False)
    assert without.links == ("l0",)
    assert without.pairs == ()


def test_wrong_arguments_are_told():
    spheres = SelfCollisions(robot(sphere(0.1), sphere(0.1)), ())
    with pytest.raises(InvalidValueError, match=r"\(n, 2, 7\) \(got \(1, 3, 7\)\)"):
        spheres.contacts(np.zeros((1, 3, 7)))
    with pytest.raises(InvalidValueError, match="must be finite"):
        spheres.contacts(np.full((1, 2, 7), np.nan))
    others = AllowedPairs("other", ("l0",), ())
    with pytest.raises(AllowedPairsError, match=r"'other'.*'r': l1"):
        SelfCollisions(robot(sphere(0.1), sphere(0.1)), others)


def test_no_frames_no_contacts():
    spheres = SelfCollisions(robot(sphere(0.1), sphere(0.1)), ())
    found = spheres.contacts(np.zeros((0, 2, 7)))
    assert found.points_a.shape == (0, 3)


@pytest.fixture(scope="module")
def g1_robot(g1_text):
    """Give the G1, its collisions but for adjacent links, and random poses."""
    description = parse_urdf(g1_text)
    collisions = SelfCollisions(description, adjacent_pairs(description))
    return (
        description,
        collisions,
        random_poses(description, np.random.RandomState(7), 100),
    )


@pytest.mark.slow
def test_the_order_of_frames_does_not_matter(g1_robot):
    """To the last bit: PyBullet keeps nothing, no sum depends on what is beside it."""
    _, collisions, poses = g1_robot
    together = collisions.contacts(poses, 0.01)
    order = np.random.RandomState(0).permutation(len(poses))
    shuffled = collisions.contacts(poses[order], 0.01)
    where = np.argsort(order)
    rows = np.concatenate(
        [np.flatnonzero(shuffled.sample == where[i]) for i in range(len(poses))]
    )
    again = shuffled[rows]
    again.sample[:] = order[again.sample]
    assert same(together, again)
    for frame in (0, 57, 99):
        alone = collisions.contacts(poses[frame : frame + 1], 0.01)
        alone.sample[:] = frame
        assert same(together[together.sample == frame], alone)


def test_where_the_robot_stands_does_not_matter(g1_robot):
    _, collisions, poses = g1_robot
    poses = poses[:50]
    moved = poses.copy()
    turned = Rotation.from_euler("xyz", [0.5, 1.0, -2.0])
    moved[..., :3] = turned.apply(poses[..., :3].reshape(-1, 3)).reshape(50, -1, 3) + 9
    rotations = turned * Rotation.from_quat(poses[..., 3:].reshape(-1, 4))
    moved[..., 3:] = rotations.as_quat().reshape(50, -1, 4)
    first, second = collisions.contacts(poses), collisions.contacts(moved)
    sure = first.distance < -1e-4
    keys = set(zip(second.sample, second.pair))
    assert {*zip(first.sample[sure], first.pair[sure])} <= keys
    assert turned.apply(first.points_a[:1]) + 9 == pytest.approx(
        second.points_a[:1], abs=1e-3
    )


PLATE = [[0.0, 0.1, 0.0], [0.2, 0.0, 0.0], [0.1, 0.3, 0.0], [-0.1, 0.2, 0.0]]
OFFSETS = [
    [0, 0, 0],
    [0.02, 0, 0],
    [0.1, 0.1, 0.02],
    [0.2, 0, 0],
    [0.2000005, 0, 0],
    [0.2, 0.3, 0.1],
]


def convex_shapes():
    """Make hulls, a ball, a box, a flat plate, a rod and a point."""
    random = np.random.RandomState(5)
    round_points = random.normal(size=(40, 3))
    round_points /= 10.0 * np.linalg.norm(round_points, axis=1, keepdims=True)
    corners = np.array(np.meshgrid(*[(-0.1, 0.1)] * 3)).reshape(3, 8).T
    rod = np.array([[0.0, 0.0, -0.1], [0.0, 0.1, 0.1]])
    blocks = [0.1 * random.normal(size=(12, 3)), round_points, corners, np.array(PLATE)]
    shapes = [ConvexShape(0, points, 0.0) for points in blocks]
    return [
        *shapes,
        ConvexShape(0, rod, 0.03),
        ConvexShape(0, np.array([[0.01, 0.02, 0.03]]), 0.05),
    ]


def distance_to(points):
    """Measure from the origin to a hull: the shortest convex combination."""
    shares, _ = nnls(np.vstack([points.T, np.ones(len(points))]), [0, 0, 0, 1])
    return np.linalg.norm(shares @ points / shares.sum())


def gap_between(a, b):
    """Measure a gap or an overlap by the hull of all differences."""
    differences = (b[:, np.newaxis] - a).reshape(-1, 3)
    try:
        hull = ConvexHull(differences)
    except (RuntimeError, ValueError):  # flat
        return distance_to(differences)
    depth = hull.equations[:, 3].max()
    return depth if depth <= 0.0 else distance_to(differences[hull.vertices])


def every_pair(shapes):
    """Place all pairs of shapes, parallel and turned, inside each other and apart."""
    turns = [Rotation.identity(), *Rotation.random(2, random_state=2)]
    cases = [
        (a, b, turn.as_quat(), size * np.array(offset))
        for a in range(len(shapes))
        for b in range(len(shapes))
        for turn in turns
        for offset in OFFSETS
        for size in (1.0, -1.0)
    ]
    a, b, rotations, origins = (np.array(column) for column in zip(*cases))
    return ShapePairs(a, b, axes_of(rotations), origins, rotations)


def test_gaps_and_overlaps_are_exact_without_pybullet():
    """Against the hull of the differences of all points, degenerate shapes too."""
    shapes = convex_shapes()
    placed = every_pair(shapes)
    found = ClosestPoints(shapes, Separation(shapes)).distances(placed)
    for a, b, axes, origin, width, normal, point in zip(
        placed.a, placed.b, placed.axes, placed.origin, *found
    ):
        first, second = shapes[a], shapes[b]
        others = second.points @ axes.T + origin
        radius = first.radius + second.radius
        assert width == pytest.approx(
            gap_between(first.points, others) - radius, 0, 1e-6
        )
        assert np.linalg.norm(normal) == pytest.approx(1.0)
        at_a = point - first.radius * normal
        at_b = point + (width + second.radius) * normal
        assert distance_to(first.points - at_a) < 1e-5
        assert distance_to(others - at_b) < 1e-5


def test_a_gap_without_pybullet_does_not_depend_on_others():
    shapes = convex_shapes()
    placed, points = every_pair(shapes), ClosestPoints(shapes, Separation(shapes))
    together = points.distances(placed)
    order = np.random.RandomState(0).permutation(len(placed.a))
    for rows in (order, order[:40], order[40:41], order[41:42]):
        for all_values, values in zip(together, points.distances(placed[rows])):
            assert np.array_equal(all_values[rows], values)


WITHOUT_PYBULLET = """
import sys
sys.modules["pybullet"] = None
import numpy as np
from g1_description import Robot
robot = Robot(sys.argv[1])
positions = robot.random_configuration(3, size=20)
found = robot.self_collisions(positions, margin=0.02)
np.savetxt(sys.stdout, np.stack([found.sample, found.pair, found.distance], axis=-1))
"""


def test_without_pybullet_the_same_contacts_are_found(g1_file):
    command = [sys.executable, "-c", WITHOUT_PYBULLET, str(g1_file)]
    done = subprocess.run(command, stdout=subprocess.PIPE, check=True)
    sample, pair, distance = np.loadtxt(io.BytesIO(done.stdout)).T
    robot = Robot(str(g1_file))
    positions = robot.random_configuration(3, size=20)
    found = robot.self_collisions(positions, margin=0.02)
    assert (found.sample == sample).all() and (found.pair == pair).all()
    assert found.distance == pytest.approx(distance, abs=1e-4)


KEPT_TO_THE_END = """
import numpy
from g1_description import Robot
robot = numpy.robot = Robot()
robot.self_collisions(robot.random_configuration(1))
"""


def test_a_robot_that_lives_to_the_end_prints_nothing():
    command = [sys.executable, "-c", KEPT_TO_THE_END]
    done = subprocess.run(command, stderr=subprocess.PIPE, check=True)
    assert done.stderr == b""


class Oracle:
    """hpp-fcl on the hulls of a robot, as they are in the files."""

    def __init__(self, description):
        self.fcl = pytest.importorskip("hppfcl", reason="hpp-fcl is not there")
        self.shapes = []
        links = [*description.links]
        used = [link.collisions or link.visuals for link in links]
        meshes, _ = find_meshes(part for parts in used for part in parts)
        for row, parts in enumerate(used):
            for part in parts:
                points, radius = outline(part, meshes)
                points = part.pose[:3] + rotate(part.pose[3:], points)
                self.shapes.append((row, radius, *self._convex(points)))
        self.request = self.fcl.DistanceRequest()
        self.result = self.fcl.DistanceResult()

    def _convex(self, points):
        """Make a shape, of a sphere only the centre; and a sphere around it."""
        if len(points) == 1:
            return self.fcl.Sphere(1e-9), points[0], 0.0, points[0]
        hull = ConvexHull(points)
        number = {old: new for new, old in enumerate(hull.vertices)}
        vertices = self.fcl.StdVec_Vec3f()
        triangles = self.fcl.StdVec_Triangle()
        for vertex in points[hull.vertices]:
            vertices.append(vertex)
        for simplex, plane in zip(hull.simplices, hull.equations):
            a, b, c = points[simplex]
            turn = 1 if np.cross(b - a, c - a) @ plane[:3] > 0 else -1
            triangles.append(self.fcl.Triangle(*(number[i] for i in simplex[::turn])))
        middle = points.mean(axis=0)
        reach = np.linalg.norm(points - middle, axis=1).max()
        return self.fcl.Convex(vertices, triangles), np.zeros(3), reach, middle

    def distances(self, poses, pairs, names):
        """Give the least distance by frame and pair of links, where it may be < 0."""
        found = {}
        for first, second in combinations(self.shapes, 2):
            pair = (names[first[0]], names[second[0]])
            if pair not in pairs:
                continue
            (row_a, *_, reach_a, middle_a), (row_b, *_, reach_b, middle_b) = (
                first,
                second,
            )
            a, b = poses[:, row_a], poses[:, row_b]
            apart = a[:, :3] + rotate(a[:, 3:], middle_a)
            apart = apart - b[:, :3] - rotate(b[:, 3:], middle_b)
            reach = reach_a + reach_b + first[1] + second[1]
            for frame in np.flatnonzero(np.linalg.norm(apart, axis=1) < reach).tolist():
                distance = self._distance(first, a[frame], second, b[frame])
                key = frame, pair
                found[key] = min(found.get(key, np.inf), distance)
        return found

    def _distance(self, first, pose_a, second, pose_b):
        """Ask for one distance."""
        self.result.clear()
        placed = []
        for (_, _, shape, center, *_), pose in ((first, pose_a), (second, pose_b)):
            axes = matrix_of(Rotation.from_quat(pose[3:]))
            place = self.fcl.Transform3f(axes, pose[:3] + axes @ center)
            placed += [shape, place]
        distance = self.fcl.distance(*placed, self.request, self.result)
        return distance - first[1] - second[1]


@pytest.mark.slow
def test_another_engine_agrees(g1_robot, g1_file):
    """On random configurations, but for touching within 1 mm.

    Few with the vendor's meshes, whose many points take hpp-fcl long.
    """
    description, collisions, poses = g1_robot
    is_ours = g1_file.parent.name == "urdf"
    poses = poses if is_ours else poses[:10]
    oracle = Oracle(description)
    names = description.link_names
    expected = oracle.distances(poses, {*collisions.pairs}, names)
    found = collisions.contacts(poses, TOUCHING)
    ours = {
        (frame, collisions.pairs[pair]): distance
        for frame, pair, distance in zip(
            found.sample.tolist(), found.pair.tolist(), found.distance.tolist()
        )
    }
    deep = {key for key, distance in expected.items() if distance < -TOUCHING}
    assert len(deep) > 5 * len(poses)
    assert deep <= {key for key, distance in ours.items() if distance < 0}
    errors = np.array([ours[key] - expected[key] for key in ours])
    assert np.abs(errors).max() < (4e-4 if is_ours else 8e-4)  # docs/self_collision.md
