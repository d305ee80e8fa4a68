"""Inverse kinematics among the objects of a scene."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from g1_description import Robot, Scene, Target, box_targets, line
from g1_description.collisions.obstacles import Obstacles
from g1_description.errors import G1DescriptionError
from g1_description.robot.rotation import rotate
from g1_description.robot.transform import compose, inverse
from g1_description.scenes.carried import holds_of, motion_links, object_poses

BASE = np.array([0.0, 0.0, 0.7634, 0.0, 0.0, 0.0, 1.0])
WHOLE = {"balance": True, "avoid_collisions": True, "floor": 0.0}


@pytest.fixture(scope="module")
def g1():
    return Robot("g1_29dof")


@pytest.fixture(scope="module")
def standing(g1):
    return g1.named_configuration("stand")


def depths(g1, scene, found, object_poses=None):
    """Measure how deep anything is in an object, in [m]."""
    links = g1.forward_kinematics(found.positions, found.base)[np.newaxis]
    if object_poses is None:
        object_poses = np.array([each.pose for each in scene.values()])
    near = Obstacles(g1.description, scene).contacts_among(links, object_poses)
    return -near.distance


def shelf(**options):
    scene = Scene()
    scene.box("shelf", [0.4, 0.6, 0.03], [0.45, 0.2, 0.8], **options)
    return scene


def test_links_keep_away_from_objects(g1, standing):
    below = {"left_hand": [0.3, 0.2, 0.74]}
    assert depths(g1, shelf(), g1.ik(below, standing, BASE)).max() > 0.01
    found = g1.ik(below, standing, BASE, scene=shelf(), **WHOLE)
    assert found.reached
    assert not len(depths(g1, shelf(), found))
    inside = {"left_hand": [0.4, 0.2, 0.8]}
    found = g1.ik(inside, standing, BASE, scene=shelf(), **WHOLE)
    assert "left_rubber_hand is at shelf" in found.message
    assert depths(g1, shelf(), found).max(initial=0.0) < 1e-3
    allowed = shelf(may_touch=["left_wrist_roll_link", "left_hand"])
    touched = g1.ik(inside, standing, BASE, scene=allowed, **WHOLE)
    assert touched.errors["left_hand"].position < 0.2 * found.errors["left_hand"][0]


def test_what_a_link_carries_keeps_away_too(g1, standing):
    scene = shelf()
    hand = g1.link_poses(standing, BASE)[g1.profile.links["left_hand"]]
    scene.box("tray", [0.3, 0.02, 0.02], hand[:3] + np.array([0.3, 0, 0]))
    scene.attach("tray", "left_hand", 0.0)
    ahead = {"left_hand": [0.15, 0.2, 0.9]}
    found = g1.ik(ahead, standing, BASE, scene=scene, **WHOLE)
    assert found.reached
    turned = np.array([0.15, 0.2, 0.9, *hand[3:]])
    through = {"left_hand": turned - [0, 0, 0.1, 0, 0, 0, 0]}
    found = g1.ik(through, standing, BASE, scene=scene, **WHOLE)
    assert "tray is at shelf" in found.message
    assert found.errors["left_hand"].position > 1e-3
    assert g1.ik(through, standing, BASE, scene=shelf(), **WHOLE).reached


def test_what_is_carried_counts_in_the_balance(g1, standing):
    name = g1.profile.links["left_hand"]
    hand = g1.link_poses(standing, BASE)[name]
    grip = np.array([0.15, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0])
    scene, ahead = Scene(), {"left_hand": [0.35, 0.1, 0.9]}
    scene.box("weight", [0.1, 0.1, 0.1], compose(hand, grip), mass=5.0)
    scene.attach("weight", "left_hand", 0.0)
    found = g1.ik(ahead, standing, BASE, scene=scene, balance=0.04)
    assert found.reached and found.margin == pytest.approx(0.04, abs=1e-3)
    links = g1.link_poses(found.positions, found.base)
    weights = {each.name: each.inertial for each in g1.description.links}
    known = [(each, links[name]) for name, each in weights.items() if each]
    places = [pose[:3] + rotate(pose[3:], m.center_of_mass) for m, pose in known]
    places = [*places, compose(links[name], grip)[:3]]
    center = np.average(places, axis=0, weights=[*(m.mass for m, _ in known), 5.0])
    alone = g1.ik(ahead, standing, BASE, balance=0.04)
    others = g1.center_of_mass(alone.positions, alone.base)
    assert center[0] == pytest.approx(others[0], abs=2e-3)  # both 4 cm inside
    times = np.linspace(0.0, 2.0, 81)
    share = 0.5 - 0.5 * np.cos(np.pi * times / 2.0)
    moved = np.array([0.25, 0.15, 0.85]) + np.outer(share, [0.1, 0.0, 0.1])
    for balance in (0.04, "zmp"):
        given = {"scene": scene, "balance": balance}
        path = g1.ik_trajectory(times, {"left_hand": moved}, standing, BASE, **given)
        if balance == "zmp":
            forces = g1.contact_forces(path.motion, scene=scene)
            assert np.nanmax(forces.missing_share) < 1e-3
        else:
            checked = g1.check(path.motion, scene=scene).measured.balance
            least = checked.center_margin[5:-5].min()
            assert least == pytest.approx(balance, abs=2e-3)


def test_feet_stand_on_what_is_flat(g1, standing):
    poses, feet = g1.link_poses(standing, BASE), ("left_foot", "right_foot")
    targets = {foot: poses[g1.profile.links[foot]].copy() for foot in feet}
    targets["left_foot"][2] += 0.15
    scene = Scene()
    place = [*targets["left_foot"][:2], 0.075]
    scene.box("step", [0.3, 0.15, 0.15], place)
    low = g1.ik(targets, standing, BASE, balance=True)
    middle = sum(targets[foot][1] for foot in feet) / 2.0
    for rpy, is_between in (([0, 0, 0.1], True), ([0.3, 0, 0], False)):
        scene.move("step", place, rpy)
        found = g1.ik(targets, standing, BASE, balance=True, scene=scene)
        center = g1.center_of_mass(found.positions, found.base)[1]
        both = center - g1.center_of_mass(low.positions, low.base)[1]
        assert (found.reached and both > 0.01 and center < middle) == is_between


def test_targets_are_relative_to_objects_wherever_these_are_carried(g1, standing):
    links, palm = g1.link_poses(standing, BASE), g1.profile.points["left_palm"]
    right = links[g1.profile.links["right_hand"]]
    scene, turned = Scene(), [0.3, 0.1, 0.9, *Rotation.from_rotvec([0, 0, 1]).as_quat()]
    scene.box("box", [0.1, 0.2, 0.1], turned, may_touch=["left_hand"])
    beside = Target([0, 0.12, 0], direction=[0, -1, 0], relative_to="box")

    def is_beside(found, pose):
        hand = g1.link_poses(found.positions, found.base)[palm.link]
        relative = compose(inverse(pose), hand)
        place = relative[:3] + rotate(relative[3:], np.array(palm.point))
        faces = rotate(relative[3:], palm.axis / np.linalg.norm(palm.axis))
        assert np.abs(place - beside.position).max() < 1.5e-3
        assert faces @ beside.direction > np.cos(np.radians(0.6))

    found = g1.ik({"left_palm": beside}, standing, BASE, scene=scene)
    assert found.reached
    is_beside(found, scene["box"].pose)
    # The right hand carries it from the start, or from 0.3 s on.
    grip = np.array([0.1, 0.15, 0.05, 0.0, 0.0, 0.0, 1.0])
    scene.move("box", compose(right, grip))
    moved = right + np.array([0.1, 0.05, 0.1, 0.0, 0.0, 0.0, 0.0])
    times = np.linspace(0.0, 2.0, 41)
    share = np.clip(times - 0.5, 0.0, 1.0)[:, np.newaxis]
    way = {"right_hand": right + share * (moved - right), "left_palm": beside}
    for begin in (-np.inf, 0.3):
        scene.detach("box")
        scene.attach("box", "right_hand", begin)
        both = {**way, "right_hand": moved}
        if begin < 0.0:
            found = g1.ik(both, standing, BASE, scene=scene)
            assert found.reached
            is_beside(found, compose(moved, grip))
        for smooth in (True, False):
            path = g1.ik_trajectory(
                times, way, standing, BASE, scene=scene, smooth=smooth
            )
            assert path.results[-1].reached
            is_beside(path.results[-1], compose(moved, grip))


@pytest.mark.parametrize(
    ("relative_to", "problem"),
    [
        ("boks", "Unknown object 'boks'. Known objects: box"),
        ("box", "left_palm is relative to box, which it carries: give its place in"),
        (3, "relative_to of left_palm must be the name of an object"),
    ],
)
def test_what_a_target_cannot_be_relative_to_is_named(g1, relative_to, problem):
    scene, target = Scene(), {"left_palm": Target([0, 0, 0], relative_to=relative_to)}
    scene.box("box", [0.1, 0.1, 0.1], [0.3, 0.3, 1])
    scene.attach("box", "left_hand")
    with pytest.raises(G1DescriptionError, match=problem):
        g1.ik(target, scene=scene)
    with pytest.raises(G1DescriptionError, match=r"give a scene that|relative_to of"):
        g1.ik(target)


@pytest.mark.parametrize(
    ("scene", "problem"),
    [("shelf.yaml", "cannot be used"), ({"box": {}}, "a Scene or its file")],
)
def test_something_else_than_a_scene_is_refused(g1, scene, problem):
    with pytest.raises(G1DescriptionError, match=problem):
        g1.ik({}, scene=scene)


def test_a_box_is_put_down_among_things(g1, standing):
    def at(x, y, z, yaw):
        return np.array([x, y, z, 0.0, 0.0, np.sin(0.5 * yaw), np.cos(0.5 * yaw)])

    stops = [at(0.32, 0.2, 0.7, 0.4), at(0.36, -0.02, 0.95, 0.0)]
    stops.append(at(0.36, -0.15, 0.85, -0.4))
    times, boxes = np.zeros(1), np.array(stops[:1])
    for begin, end in zip(stops, stops[1:]):
        more, way = line(begin, end, speed=0.4)
        times = np.append(times, times[-1] + more[1:])
        boxes = np.append(boxes, way[1:], axis=0)
    scene, palms = Scene(), box_targets(boxes, 0.24)
    scene.box("box", [0.12, 0.24, 0.12], stops[0], may_touch=["right_hand"])
    scene.box("table", [0.3, 0.26, 0.04], [0.42, -0.22, 0.77])
    scene.box("wall", [0.02, 0.5, 0.6], [0.1, 0.55, 1.0])
    scene.attach("box", "left_hand", 0.0, times[-1])

    def objects_in(path):
        links = motion_links(g1.description, path.motion)
        holds = holds_of(scene.values(), g1.description, links)
        return object_poses(holds, times, links)

    def deepest(path):
        objects = objects_in(path)
        poses = g1.forward_kinematics(path.motion.positions, path.motion.base_poses)
        obstacles = Obstacles(g1.description, scene)
        return -obstacles.contacts_among(poses, objects).distance.min(initial=0.0)

    tipping = box_targets(boxes, 0.24, pitch=None)
    alone = g1.ik_trajectory(times, tipping, standing, BASE, **WHOLE)
    assert deepest(alone) > 0.01
    for targets, is_level in ((tipping, False), (palms, True)):
        path = g1.ik_trajectory(times, targets, standing, BASE, scene=scene, **WHOLE)
        assert path.message == ""
        assert deepest(path) < 1e-3
        turned = Rotation.from_quat(objects_in(path)[:, 0, 3:]).apply([0.0, 0.0, 1.0])
        assert (turned[:, 2].min() > np.cos(np.radians(1.0))) == is_level
