"""Drags of the G1 by hand: the body follows, and the feet stay."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from g1_description.ik.posing import Posing
from g1_description.robot.state import RobotState
from g1_description.sim.standing import standing_base

LEFT, RIGHT = "left_ankle_roll_link", "right_ankle_roll_link"
HAND, OTHER_HAND = "left_rubber_hand", "right_rubber_hand"


class Dragged(Posing):
    """The posing of a robot that is at once where it is commanded."""

    def __init__(self, model):
        stand = model.named_configuration("stand").tolist()
        stand = dict(zip(model.joint_names, stand))
        self.model = model
        self.command(stand, standing_base(model.description, stand))
        super().__init__(model.description, lambda: self.now, self.command)

    def command(self, positions, base):
        values = np.array([*positions.values()])
        self.now = RobotState(0, tuple(positions), values, base_pose=base)

    def places(self):
        state = self.now
        return self.model.link_poses(state.positions_by_name, state.base_pose)

    def pull(self, link, by):
        """Drag a link by a vector in [m], without turning it."""
        target = self.places()[self.roles.get(link, link)].copy()
        target[:3] += by
        return self.drag(link, target)


@pytest.fixture
def posing(g1):
    return Dragged(g1)


def assert_stays(posing, link, pose, precision=1e-4):
    np.testing.assert_allclose(posing.places()[link], pose, rtol=0, atol=precision)


def test_the_body_follows_a_hand_and_the_feet_stay(posing):
    before, way = posing.places(), np.array([0.15, 0.05, -0.25])
    last = posing.now.positions
    for _ in range(25):
        assert posing.pull("left_hand", way / 25).reached
        now = posing.now.positions
        assert np.abs(now - last).max() < 0.25, "small drags make small changes"
        last = now
    for foot in (LEFT, RIGHT):
        assert_stays(posing, foot, before[foot])
    found = posing.places()[HAND][:3]
    np.testing.assert_allclose(found, before[HAND][:3] + way, rtol=0, atol=1e-3)


def test_feet_do_not_drift_in_a_long_drag(posing):
    before = posing.places()
    target = before[OTHER_HAND].copy()
    first = target[:3].copy()
    for turn in np.linspace(0.0, 4.0 * np.pi, 60):
        target[:3] = first + 0.1 * np.array([np.sin(turn), 0.0, 1.0 - np.cos(turn)])
        posing.drag("right_hand", target)
    for foot in (LEFT, RIGHT):
        assert_stays(posing, foot, before[foot])


@pytest.mark.parametrize("balance", [True, False])
def test_balance_is_kept_where_it_is_switched_on(g1, posing, balance):
    posing.balance = balance
    for _ in range(15):
        posing.pull("left_hand", [0.04, 0.0, -0.01])
    state = posing.now
    only = ("center_of_mass",)
    verdict = g1.check_state(state.positions_by_name, state.base_pose, only)
    assert verdict.passed == balance


def test_collisions_are_avoided_where_that_is_switched_on(g1, posing):
    def collides():
        posing.pull("left_hand", [0.1, -0.21, 0.1])
        state = posing.now
        return (
            len(g1.self_collisions(state.positions_by_name, state.base_pose).pair) > 0
        )

    assert collides()
    posing.undo()
    posing.prepare(g1.checker().collisions)
    posing.avoid_collisions = True
    assert not collides()


def test_a_target_out_of_reach_is_reported_and_the_feet_stay(posing):
    foot = posing.places()[RIGHT]
    found = posing.pull("left_hand", [2.0, 0.0, 0.0])
    assert not found.reached
    assert "left_hand is" in found.message
    assert_stays(posing, RIGHT, foot, 1e-3)


def test_a_foot_is_moved_by_itself_or_let_go(posing):
    before, way = posing.places(), np.array([0.1, 0.03, 0.08])
    posing.pull("left_foot", way)
    found = posing.places()[LEFT][:3]
    np.testing.assert_allclose(found, before[LEFT][:3] + way, rtol=0, atol=1e-3)
    assert_stays(posing, RIGHT, before[RIGHT])
    posing.end_drag()
    posing.fixed_links = set()
    posing.pull("right_hand", [0.0, -0.8, 0.0])
    assert np.abs(posing.places()[RIGHT] - before[RIGHT]).max() > 1e-3


def test_a_mirrored_robot_has_its_hands_exchanged(posing):
    posing.pull("left_hand", [0.1, 0.1, 0.2])
    before = posing.places()[HAND]
    posing.mirror()
    found = posing.places()[OTHER_HAND][:3]
    np.testing.assert_allclose(found, before[:3] * [1.0, -1.0, 1.0], atol=2e-3)
    posing.undo()
    assert_stays(posing, HAND, before, 1e-9)


def test_a_reset_robot_stands_at_its_place(g1, posing):
    turn = Rotation.from_rotvec([0.0, 0.0, 0.5])
    tilted = (turn * Rotation.from_rotvec([0.3, 0.2, 0.0])).as_quat()
    bent = dict.fromkeys(g1.joint_names, 0.2)
    posing.command(bent, np.concatenate([[1.0, 2.0, 0.9], tilted]))
    posing.reset("stand")
    state = posing.now
    names = dict(zip(g1.joint_names, g1.named_configuration("stand")))
    assert state.positions_by_name == pytest.approx(names)
    np.testing.assert_allclose(state.base_pose[:2], [1.0, 2.0], atol=1e-9)
    upright = Rotation.from_quat(state.base_pose[3:]).apply([0.0, 0.0, 1.0])
    np.testing.assert_allclose(upright, [0.0, 0.0, 1.0], atol=1e-9)
    assert g1.check_state(state.positions_by_name, state.base_pose).passed
