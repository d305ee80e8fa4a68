"""Posing by hand: what stays, and what a drag keeps to."""

import numpy as np
import pytest
from robots import BASE

from g1_description import Scene
from g1_description.ik.posing import STEPS, Posing
from g1_description.robot.state import RobotState

PELVIS, OTHER_HAND = "pelvis", "right_rubber_hand"


@pytest.fixture
def posing(g1):
    """Give the posing of a robot that is at once where it is commanded."""
    state = [RobotState(0, g1.joint_names, g1.named_configuration("stand"), None, BASE)]

    def command(positions, base):
        values = np.array([*positions.values()])
        state[0] = RobotState(0, tuple(positions), values, None, base)

    one = Posing(g1.description, lambda: state[0], command)
    one.places = lambda: one.link_poses(state[0])
    return one


def lowered(posing, steps=10):
    """Drag the pelvis down by 5 cm."""
    target = posing.places()[PELVIS].copy()
    for _ in range(steps):
        target[2] -= 0.05 / steps
        found = posing.drag(PELVIS, target)
    return found


def test_steps_are_undone_before_the_state_has_followed(g1):
    sent = []
    state = RobotState(0, g1.joint_names, g1.named_configuration("stand"), None, BASE)
    one = Posing(
        g1.description, lambda: state, lambda q, base: sent.append(q["waist_yaw_joint"])
    )
    for angle in (0.1, 0.2, 0.3):
        positions = g1.positions({"waist_yaw_joint": angle})
        one.go((positions, BASE))
    one.undo()
    one.undo()
    one.redo()
    assert sent[-3:] == pytest.approx([0.2, 0.1, 0.2])


def test_a_robot_that_hangs_below_the_map_is_dragged(g1):
    """As with odometry that starts at the pelvis."""
    base = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0])
    state = [RobotState(0, g1.joint_names, g1.named_configuration("stand"), None, base)]
    one = Posing(g1.description, lambda: state[0], lambda *_: None)
    hand = one.link_poses(state[0])["left_rubber_hand"].copy()
    hand[:3] += [0.03, 0.0, 0.03]
    assert one.drag("left_hand", hand).reached


@pytest.mark.parametrize("is_fixed", [True, False])
def test_any_link_can_be_fixed(posing, is_fixed):
    before = posing.places()[OTHER_HAND]
    posing.fixed_links |= {"right_hand"} if is_fixed else set()
    assert lowered(posing).reached
    stays = np.abs(posing.places()[OTHER_HAND] - before).max() < 1e-3
    assert stays == is_fixed


def test_a_fixed_hand_alone_supports_nothing(posing):
    """Balance needs fixed feet; else it is not kept, and nothing is refused."""
    posing.fixed_links = {"right_hand"}
    before = posing.places()[OTHER_HAND]
    assert lowered(posing).reached
    np.testing.assert_allclose(posing.places()[OTHER_HAND], before, atol=1e-3)


def test_links_are_dragged_by_their_centres(g1, posing):
    """Head, torso and pelvis of the G1 have nearly the same origin."""
    assert np.linalg.norm(posing.centers["head"]) > 0.3
    pose, center = posing.places()["head_link"], posing.centers["head"]
    target = np.concatenate([pose[:3] + center + [0.02, 0.0, -0.02], pose[3:]])
    assert posing.drag("head", target, center).reached
    found = posing.places()["head_link"]
    np.testing.assert_allclose(found[:3] + center, target[:3], rtol=0, atol=1e-3)


@pytest.mark.parametrize("is_let_go", [False, True])
def test_a_search_whose_results_are_followed_ends_where_a_drag_does(posing, is_let_go):
    target = np.add(posing.places()["head_link"][:3], [3.0, 0.0, 0.0])
    whole = posing.drag("head", target)
    posing.undo()
    pieces = posing.search("head", target)
    if is_let_go:
        posing.end_drag()
    steps = [0]
    for found in pieces:
        posing.follow(found)
        steps.append(found.steps)
    assert len(steps) > 3
    assert (np.diff(steps) <= STEPS).all()
    assert steps[-1] == whole.steps
    np.testing.assert_array_equal(found.positions, whole.positions)
    np.testing.assert_array_equal(found.base, whole.base)
    np.testing.assert_array_equal(posing.place()[0], whole.positions)


def test_the_standing_pose_is_that_of_the_profile(posing):
    assert posing.standing_pose == "stand"


@pytest.mark.parametrize("avoids", [True, False])
def test_a_dragged_hand_feels_objects(g1, posing, avoids):
    posing.scene, posing.avoid_collisions = Scene(), avoids
    posing.scene.box("table", [1.0, 2.0, 0.04], [0.68, 0.0, 0.68])
    target = np.array([0.35, 0.2, 0.9])
    posing.drag("left_hand", target)
    for _ in range(20):
        target[2] -= 0.02
        found = posing.drag("left_hand", target)
    height = posing.places()["left_rubber_hand"][2]
    assert (height > 0.7) == avoids
    assert ("at table" in found.message) == avoids
