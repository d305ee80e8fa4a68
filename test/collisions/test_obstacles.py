"""A robot among objects, held against hpp-fcl and geometry."""

import numpy as np
import pytest
from oracle import matrix_of
from scipy.spatial.transform import Rotation

from g1_description import Scene
from g1_description.collisions.obstacles import Obstacles
from g1_description.errors import G1DescriptionError
from g1_description.robot.description import Description, Joint, Link, Shape
from g1_description.robot.rotation import rotate
from g1_description.robot.transform import IDENTITY

N_PAIRS = 400


def free_links(*shapes):
    """Make a robot of links that float."""
    links = [Link(f"l{n}", None, (), (shape,)) for n, shape in enumerate(shapes)]
    joints = [
        Joint(f"j{n}", "revolute", "l0", f"l{n}", IDENTITY)
        for n in range(1, len(shapes))
    ]
    return Description("r", "l0", tuple(links), tuple(joints))


def ball(radius):
    return Shape("sphere", (radius,), IDENTITY)


def at(*rows):
    return np.array([[[*row, 0.0, 0.0, 0.0, 1.0] for row in rows]])


def poses_of(scene):
    return np.array([each.pose for each in scene.values()])


def test_distances_and_depths_agree_with_hpp_fcl():
    fcl = pytest.importorskip("hppfcl")
    rng = np.random.default_rng(0)
    sizes = {"box": 3, "sphere": 1, "cylinder": 2}
    shapes = {"box": fcl.Box, "sphere": fcl.Sphere, "cylinder": fcl.Cylinder}

    def transform(pose):
        turn = matrix_of(Rotation.from_quat(pose[3:]))
        return fcl.Transform3f(turn, pose[:3])

    def drawn():
        kind = rng.choice([*sizes])
        turn = rng.normal(size=4)
        place = 0.3 * rng.normal(size=3)
        pose = np.concatenate([place, turn / np.linalg.norm(turn)])
        return kind, tuple(rng.uniform(0.03, 0.5, sizes[kind])), pose

    depths = 0
    for _ in range(N_PAIRS):
        (kind, size, pose), (other, lengths, place) = drawn(), drawn()
        scene = Scene()
        arguments = (lengths,) if other == "box" else lengths
        getattr(scene, other)("thing", *arguments, place)
        obstacles = Obstacles(free_links(Shape(kind, size, IDENTITY)), scene)
        found = obstacles.contacts_among(pose[None, None], poses_of(scene), 5.0)
        ours = shapes[kind](*size), transform(pose)
        theirs = shapes[other](*lengths), transform(place)
        distance = fcl.DistanceResult()
        fcl.distance(*ours, *theirs, fcl.DistanceRequest(), distance)
        expected = distance.min_distance
        if expected < 1e-6:
            request, contact = fcl.CollisionRequest(), fcl.CollisionResult()
            request.enable_contact = True
            fcl.collide(*ours, *theirs, request, contact)
            expected = -abs(contact.getContact(0).penetration_depth)
            depths += 1
        # hpp-fcl's depth of a ball whose middle is inside a cylinder is too large.
        radii = [lengths[0]] * (other == "sphere") + [size[0]] * (kind == "sphere")
        is_inside = -found.distance[0] > min(radii, default=np.inf)
        assert is_inside or abs(found.distance[0] - expected) < 1e-4
        assert found.distance[0] > expected - 1e-4
        between = found.points_b[0] - found.points_a[0]
        np.testing.assert_allclose(between, found.distance[0] * found.normal[0])
    assert depths > N_PAIRS / 20


def test_planes_are_half_spaces_whatever_the_link():
    scene = Scene()
    turned = np.array([0.0, 0.0, 1.0, 0.1, 0.2, 0.3, np.sqrt(1.0 - 0.14)])
    scene.plane("roof", [0, 0, -1], turned)
    shapes = [Shape("box", (0.2, 0.3, 0.4), IDENTITY), ball(0.1)]
    obstacles = Obstacles(free_links(*shapes), scene)
    poses = at([0.1, 0.2, 0.9], [5.0, 0.0, 0.5])
    found = obstacles.contacts_among(poses, poses_of(scene), 10.0)
    normal = rotate(turned[3:], np.array([0.0, 0.0, -1.0]))
    middles = (poses[0, :, :3] - turned[:3]) @ normal
    reach = [np.abs(normal) @ [0.1, 0.15, 0.2], 0.1]
    np.testing.assert_allclose(found.distance, middles - reach)
    np.testing.assert_allclose(found.normal, [-normal, -normal])


def test_carriers_and_what_may_touch_are_left_out():
    scene = Scene()
    scene.box("box", [0.2, 0.2, 0.2], [0, 0, 1], may_touch=["l1"])
    scene.box("table", [1, 1, 0.1], [0, 0, 0.85], may_touch=["cup"])
    scene.sphere("cup", 0.1, [0, 0, 1])
    scene.attach("box", "l0", 1.0)
    scene.attach("cup", "l2", 1.0)
    obstacles = Obstacles(free_links(*[ball(0.1)] * 3), scene)
    of_links = {(f"l{n}", "table") for n in range(3)} | {("l2", "box")}
    of_links |= {("l1", "cup")}  # l0 is the wrist of the hand l2
    carried = {("box", "table"), ("cup", "box")}
    carried |= {("box", "the floor"), ("cup", "the floor")}
    assert {frozenset(p) for p in obstacles.pairs} == {
        frozenset(p) for p in of_links | carried
    }
    scene.remove("cup")  # which the table may still touch
    assert ("l0", "table") in Obstacles(free_links(*[ball(0.1)] * 3), scene).pairs
    scene.attach("table", "nobody")
    with pytest.raises(G1DescriptionError, match="names the link nobody"):
        Obstacles(free_links(*[ball(0.1)] * 3), scene)


def test_objects_far_away_change_nothing():
    near, many = Scene(), Scene()
    for scene in (near, many):
        scene.box("step", [0.4, 0.4, 0.2], [0.2, 0, 0])
    for number in range(200):
        many.sphere(f"ball_{number}", 0.1, [10.0 + number, 0, 0])
    robot = free_links(ball(0.2), Shape("box", (0.1, 0.2, 0.3), IDENTITY))
    rng = np.random.default_rng(1)
    poses = np.concatenate(
        [0.2 * rng.normal(size=(300, 2, 3)), rng.normal(size=(300, 2, 4))], 2
    )
    poses[..., 3:] /= np.linalg.norm(poses[..., 3:], axis=2, keepdims=True)
    one, other = (
        Obstacles(robot, s).contacts_among(poses, poses_of(s)) for s in (near, many)
    )
    assert len(one.sample) > 100
    np.testing.assert_array_equal(one.distance, other.distance)
