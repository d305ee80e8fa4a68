"""Targets that leave a choice, and the distance from the edge that balance keeps."""

import numpy as np
import pytest
from conftest import REPOSITORY
from robots import BASE
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation
from trimesh import load

from g1_description import Robot, Target, box_targets, line
from g1_description.errors import InvalidValueError
from g1_description.sim.standing import outlines

FEET = ("left_ankle_roll_link", "right_ankle_roll_link")
UPPER = {"fixed_links": (), "base_motion": "fixed"}
ANGLE = np.radians(0.5)
PALMS = {"left_palm": "left_rubber_hand", "right_palm": "right_rubber_hand"}


def unit(vector):
    return vector / np.linalg.norm(vector, axis=-1, keepdims=True)


def place(poses, link, point=(0.0, 0.0, 0.0)):
    """Return the rotation of a link and a point of it in the world."""
    turned = Rotation.from_quat(poses[link][..., 3:])
    return turned, poses[link][..., :3] + turned.apply(point)


def margin(robot, positions, base, feet=FEET):
    """Measure how far the centre of mass, and the middle, are from the soles' edge."""
    poses, corners = robot.link_poses(positions, base), []
    for link in feet:
        (shape,) = (each for each in robot.description.links if each.name == link)
        points, radii = outlines(shape)
        turned, origin = place(poses, link)
        corners.append(turned.apply(points) + origin - np.outer(radii, [0, 0, 1]))
    corners = np.concatenate(corners)
    hull = ConvexHull(corners[corners[:, 2] < corners[:, 2].min() + 0.01, :2])
    center = robot.center_of_mass(positions, base)[:2]
    places = np.array([center, hull.points[hull.vertices].mean(axis=0)])
    return -(places @ hull.equations[:, :2].T + hull.equations[:, 2]).max(axis=1)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("kind", ["rotation", "direction", "look_at"])
@pytest.mark.parametrize("is_placed", [True, False])
def test_what_a_configuration_has_is_reached(g1, seed, kind, is_placed):
    """Of a hand with a point, in another configuration near the start."""
    random = np.random.default_rng(seed)
    start = g1.named_configuration("stand")
    there = np.clip(start + random.uniform(-0.5, 0.5, 29), g1.lower, g1.upper)
    axis, point = unit(random.normal(size=3)), random.uniform(-0.1, 0.1, 3)
    turned, at = place(g1.link_poses(there, BASE), "left_rubber_hand", point)
    aim = turned.apply(axis)
    given = {
        "rotation": {"rotation": turned.as_quat()},
        "direction": {"direction": 3.0 * aim, "axis": 2.0 * axis},
        "look_at": {"look_at": at + 0.7 * aim, "axis": axis},
    }[kind]
    target = Target(at if is_placed else None, point=point, **given)
    result = g1.ik({"left_hand": target}, start, BASE, **UPPER)
    assert result.reached
    now, found = place(
        g1.link_poses(result.positions, result.base), "left_rubber_hand", point
    )
    error = result.errors["left_hand"]
    if is_placed:
        assert np.linalg.norm(found - at) < 1e-3
    else:
        assert error.position is None
    if kind == "look_at":
        aim = unit(given["look_at"] - found)
    away = np.linalg.norm((now.inv() * turned).as_rotvec())
    if kind != "rotation":
        away = np.arccos(min(now.apply(axis) @ aim, 1.0))
    assert away < ANGLE
    assert error.rotation == pytest.approx(away, abs=1e-6)


def test_a_head_that_cannot_look_behind_says_by_how_much(g1):
    target = {"head": Target(look_at=[-3.0, 0.0, 1.2])}
    result = g1.ik(target, g1.named_configuration("stand"), BASE, **UPPER)
    angle = f"{np.degrees(result.errors['head'].rotation):.2g}"
    assert result.message == f"Not reached: head is {angle} degrees from its target."


@pytest.mark.parametrize("model", ["g1_29dof", "g1_23dof", "g1_29dof_rev_1_0"])
def test_palms_are_planes_that_heel_and_fingertips_touch(model):
    robot = Robot(model)
    assert {*robot.profile.points} == {*PALMS}
    for palm in robot.profile.points.values():
        mesh = load(str(REPOSITORY / "meshes" / f"{palm.link}.stl"))
        offset = 0.1255 if "wrist" in palm.link else 0.0
        hand = mesh.vertices[mesh.vertices[:, 0] > offset]
        out = (hand - palm.point) @ unit(np.array(palm.axis))
        assert -1e-3 < out.max() < 1e-3
        touching = hand[out > -2e-3, 0] - offset
        assert touching.min() < 0.02
        assert touching.max() > 0.12


def test_palms_hold_a_box_that_moves(g1):
    """On a line, turned; width and sides by forward kinematics."""
    times, yaw = np.linspace(0.0, 1.0, 11), np.linspace([0, 0, 0], [0, 0, 0.3], 11)
    places = np.linspace([0.35, 0.0, 0.85], [0.4, 0.1, 0.75], 11)
    boxes = np.concatenate([places, Rotation.from_rotvec(yaw).as_quat()], axis=1)
    standing = g1.named_configuration("stand")
    path = g1.ik_trajectory(
        times, box_targets(boxes, 0.24, pitch=0.2), standing, BASE, balance=True
    )
    assert path.reached
    for q, base, box in zip(path.motion.positions, path.motion.base_poses, boxes):
        poses = g1.link_poses(q, base)
        palms = [g1.profile.points[name] for name in PALMS]
        (left, a), (right, b) = (place(poses, p.link, p.point) for p in palms)
        across = Rotation.from_quat(box[3:]).apply([0.0, 1.0, 0.0])
        np.testing.assert_allclose(a - b, 0.24 * across, atol=2e-3)
        np.testing.assert_allclose(0.5 * (a + b), box[:3], atol=1e-3)
        fingers = Rotation.from_quat(box[3:]).apply([np.cos(0.2), 0.0, -np.sin(0.2)])
        for turned, palm, way in zip((left, right), palms, (-across, across)):
            axis = unit(np.array(palm.axis))
            assert turned.apply(axis) @ way > np.cos(ANGLE)
            ahead = turned.apply(unit(np.cross(axis, np.cross([1.0, 0.0, 0.0], axis))))
            assert ahead @ fingers > np.cos(ANGLE)


@pytest.mark.parametrize("is_function", [False, True])
def test_a_path_takes_one_value_for_all_samples_too(g1, is_function):
    times, look = np.linspace(0.0, 0.5, 6), np.linspace([2, -0.3, 0], [2, 0.3, 0], 6)
    hand = g1.link_poses(g1.named_configuration("stand"), BASE)["left_rubber_hand"]

    def head(time):
        return Target(look_at=look[np.searchsorted(times, time)], axis=[1.0, 0.0, 0.0])

    targets = {"head": head if is_function else Target(look_at=look), "left_hand": hand}
    path = g1.ik_trajectory(times, targets, "stand", BASE)
    assert path.reached
    for q, base, goal in zip(path.motion.positions, path.motion.base_poses, look):
        poses = g1.link_poses(q, base)
        np.testing.assert_allclose(poses["left_rubber_hand"][:3], hand[:3], atol=1e-3)
        turned, eye = place(poses, "head_link")
        assert turned.apply([1.0, 0.0, 0.0]) @ unit(goal - eye) > np.cos(ANGLE)


@pytest.mark.parametrize(
    ("balance", "needed"),
    [(True, 0.03), (0.01, 0.01), (0.05, 0.05), (None, None), (0, None), (False, None)],
)
def test_balance_keeps_the_margin_that_is_given(g1, balance, needed):
    target, start = {"left_hand": [0.6, 0.2, 0.4]}, g1.named_configuration("stand")
    result = g1.ik(target, start, BASE, balance=balance)
    assert result.reached
    found, _ = margin(g1, result.positions, result.base)
    if needed is None:
        assert result.margin is None
    else:
        assert result.margin == pytest.approx(found, abs=1e-4)
        assert result.margin > needed - 1e-3


def test_on_one_foot_the_default_margin_is_half_the_way_to_its_middle(g1):
    start, hold = g1.named_configuration("stand"), {"fixed_links": ["left_foot"]}
    result = g1.ik({"left_hand": [0.5, 0.0, 0.7]}, start, BASE, balance=True, **hold)
    assert result.reached
    found, middle = margin(g1, result.positions, result.base, FEET[:1])
    assert result.margin == pytest.approx(found, abs=1e-4)
    assert found == pytest.approx(0.5 * middle, abs=1e-3)


@pytest.mark.parametrize(
    ("balance", "smooth", "falls"), [(True, True, False), (0.01, False, True)]
)
def test_a_slow_reach_with_the_default_margin_does_not_fall_in_physics(
    g1, balance, smooth, falls
):
    start = g1.named_configuration("stand")
    hand = g1.link_poses(start, BASE)["left_rubber_hand"][:3]
    times, way = line(hand, [0.75, 0.2, 0.8], speed=0.2, period=0.05)
    path = g1.ik_trajectory(
        times, {"left_hand": way}, start, BASE, balance=balance, smooth=smooth
    )
    assert path.reached
    verdict = g1.checker(physics=True).check(path.motion)
    assert ("fall" in [finding.check for finding in verdict.findings]) == falls


def test_a_margin_that_is_missed_is_reported(g1):
    start = g1.named_configuration("stand")
    result = g1.ik({"left_hand": [0.3, 0.2, 0.8]}, start, BASE, balance=0.2)
    assert not result.reached
    assert 0.0 < result.margin < 0.2
    found = f"is {1e3 * result.margin:.0f} mm inside of what supports the robot, "
    assert f"{found}not at least 200 mm inside" in result.message


ROTATION = [0.0, 0.0, 0.0, 1.0]
UP = [0.0, 0.0, 1.0]


@pytest.mark.parametrize(
    ("target", "problem"),
    [
        (Target(), "target of head needs a position, rotation, direction or look_at"),
        (Target(rotation=ROTATION, axis=UP), "has both rotation and axis"),
        (Target(rotation=ROTATION, look_at=UP), "has both look_at and rotation"),
        (Target(direction=UP, look_at=UP), "has both direction and look_at"),
        (Target(direction=UP), "direction of head needs an axis of the link"),
        (Target(UP, axis=UP), "axis of head needs a direction along which it points"),
        (Target(direction=UP, axis=[0, 0, 0]), "axis of head must not have length 0"),
        (Target(direction=[0, 0, 0], axis=UP), "direction of head must not have len"),
        (Target(direction="up", axis=UP), r"direction of head must be x y z .*got up"),
        (Target(look_at=[np.nan, 0, 0]), "look_at of head must be .* of finite num"),
        (Target(look_at=[900, 0, 0]), "look_at of head is 900 m from the robot"),
        (Target(UP, look_at=UP), "look_at of head is at the link itself"),
        (Target(UP, forward=UP), "forward of head needs a direction"),
        (Target(direction=UP, axis=[0, 1, 0], forward=UP), "must not be along its dir"),
        (Target(direction=UP, axis=[1, 0, 0], forward=[0, 1, 0]), "nor the axis along"),
        (Target(rotation=[0, 0, 0, 2]), r"quaternion of head must have .* \(got 2\)"),
        (Target(np.zeros((2, 3))), r"position of head must be one .*shape \(2, 3\)"),
        (Target(UP, point=[0, 0]), "point of head must be x y z in its frame"),
    ],
)
def test_a_wrong_target_is_refused_in_a_sentence(g1, target, problem):
    with pytest.raises(InvalidValueError, match=problem):
        g1.ik({"head": target}, base=BASE)


def test_a_wrong_sample_is_refused_with_its_time(g1):
    wrong = [UP, [0.0, 0.0, 0.0]]
    for target, problem in (
        (Target(direction=wrong, axis=UP), "of head at 0.500 s must not have length 0"),
        (Target(direction=[*wrong, UP], axis=UP), "2 times but 3 targets of head"),
    ):
        with pytest.raises(InvalidValueError, match=problem):
            g1.ik_trajectory([0.0, 0.5], {"head": target}, base=BASE)


@pytest.mark.parametrize(
    ("pose", "width", "pitch", "problem"),
    [
        ([0, 0, 1], 0.3, 0.0, "The box must be seven finite numbers"),
        ([0, 0, 1, 0, 0, 0, 2], 0.3, 0.0, "The box quaternion must have length 1"),
        ([0, 0, 1, 0, 0, 0, 1], 300, 0.0, r"width of the box must be in m.*got 300"),
        ([0, 0, 1, 0, 0, 0, 1], 0.3, "up", r"pitch must be a number in rad.*got up"),
    ],
)
def test_a_wrong_box_is_refused_in_a_sentence(pose, width, pitch, problem):
    with pytest.raises(InvalidValueError, match=problem):
        box_targets(pose, width, pitch=pitch)
