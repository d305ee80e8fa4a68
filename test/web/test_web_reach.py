"""Gizmos on hands, feet and other links, which the whole body follows."""

from __future__ import annotations

import sys
import threading
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from waiting import wait_for

pytest.importorskip("viser", reason="viser is not installed")

import viser

from g1_description import Robot
from g1_description.errors import InvalidValueError
from g1_description.ik.posing import roles_of
from g1_description.robot.urdf import parse_urdf
from g1_description.web import controls, reach_panel
from g1_description.web.controls import JointPanel
from g1_description.web.file_world import FileWorld, StillRobot
from g1_description.web.reach_panel import ReachPanel
from g1_description.web.scene.robot import SceneRobot
from g1_description.web.scene.stage import Stage
from g1_description.web.server.address import ServerOptions
from g1_description.web.show import Show
from g1_description.web.ui_loop import UiLoop

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "tools"))
from web_clients import running

from page_client import PageClient

BASE = np.array([0.0, 0.0, 0.7634, 0.0, 0.0, 0.0, 1.0])
LEFT, RIGHT = "left_ankle_roll_link", "right_ankle_roll_link"
HAND = "left_rubber_hand"


@pytest.fixture(scope="module")
def g1():
    return Robot()


@pytest.fixture(scope="module")
def server():
    one = viser.ViserServer(host="127.0.0.1", port=0, verbose=False)
    yield one
    one.stop()


class Clock:
    """A time that passes when a test wants it to."""

    def __init__(self):
        self.now = 100.0

    def monotonic(self):
        return self.now


@pytest.fixture
def clock(monkeypatch):
    one = Clock()
    monkeypatch.setattr(reach_panel, "time", one)
    monkeypatch.setattr(controls, "time", one)
    return one


@pytest.fixture
def robot(g1):
    one = StillRobot("g1", g1.description)
    stand = dict(zip(g1.joint_names, g1.pose("stand").tolist()))
    one.command_all(stand, BASE)
    return one


@pytest.fixture
def panel(g1, server, robot, clock):
    ui = UiLoop(server, threading.Event())
    joints = JointPanel(server.gui, ui, robot)
    shapes = g1.checker().collisions
    body = SceneRobot(server.scene, "/robots/g1", robot.description)
    stage = Stage(server)
    one = ReachPanel(server, ui, robot, joints, body, stage, lambda: shapes)
    one._on.value = True
    one._show_gizmos()
    one.follow(robot.state())
    one.ui, one.stage = ui, stage
    return one


def places(g1, robot):
    state = robot.state()
    return g1.link_poses(state.positions_by_name, state.base_pose)


def center_of(g1, where, link):
    """Return where the centre of mass of a link is."""
    (inertial,) = (o.inertial for o in g1.description.links if o.name == link)
    pose = where[link]
    return pose[:3] + Rotation.from_quat(pose[3:]).apply(inertial.center_of_mass)


def drag(panel, role, by):
    """Move a gizmo, as viser does with what a browser sends."""
    gizmo = panel._gizmos[role]
    gizmo.position, gizmo.wxyz = gizmo.position + by, np.array(gizmo.wxyz)
    panel._dragged(role)
    search(panel)


def search(panel):
    """Let the panel search to the end."""
    wait_for(lambda: not panel._lane.is_busy, "the search")
    panel.ui.do_all()


def test_gizmos_are_on_their_links_while_they_are_shown(g1, panel, robot, clock):
    where = places(g1, robot)
    for role, link in (("left_hand", HAND), ("pelvis", "pelvis"), ("left_foot", LEFT)):
        gizmo = panel._gizmos[role]
        assert gizmo.visible
        center = center_of(g1, where, link)
        np.testing.assert_allclose(gizmo.position, center, atol=1e-9)
        turn = np.abs(np.dot(gizmo.wxyz, where[link][[6, 3, 4, 5]]))
        assert turn == pytest.approx(1.0)
    panel._on.value = False
    panel._show_gizmos()
    assert not panel._gizmos["left_hand"].visible
    robot.command({"left_elbow_joint": 1.5})
    clock.now += 1.0
    panel.follow(robot.state())
    before = center_of(g1, where, HAND)
    np.testing.assert_allclose(panel._gizmos["left_hand"].position, before, atol=1e-9)


def test_the_body_follows_a_hand_and_the_feet_stay(g1, panel, robot):
    feet = [places(g1, robot)[foot].copy() for foot in (LEFT, RIGHT)]
    goal = places(g1, robot)[HAND][:3] + np.array([0.15, 0.05, -0.25])
    for _ in range(25):
        drag(panel, "left_hand", [0.006, 0.002, -0.01])
    now = places(g1, robot)
    np.testing.assert_allclose(now[HAND][:3], goal, rtol=0, atol=1e-3)
    for foot, pose in zip((LEFT, RIGHT), feet):
        np.testing.assert_allclose(now[foot], pose, rtol=0, atol=1e-4)
    assert not panel._told.visible


def test_feet_do_not_drift_in_a_long_drag(g1, panel, robot):
    feet = [places(g1, robot)[foot].copy() for foot in (LEFT, RIGHT)]
    first = panel._gizmos["right_hand"].position.copy()
    for turn in np.linspace(0.0, 6.0 * np.pi, 150):
        circle = np.array([np.sin(turn), 0.0, 1.0 - np.cos(turn)])
        wanted = first + 0.1 * circle
        drag(panel, "right_hand", wanted - panel._gizmos["right_hand"].position)
    now = places(g1, robot)
    for foot, pose in zip((LEFT, RIGHT), feet):
        np.testing.assert_allclose(now[foot], pose, rtol=0, atol=1e-4)


def test_small_drags_make_small_changes(g1, panel, robot):
    last = robot.state().positions
    for _ in range(40):
        drag(panel, "left_hand", [0.01, 0.0, 0.0])
        now = robot.state().positions
        assert np.abs(now - last).max() < 0.25
        last = now


@pytest.mark.parametrize("balance", [True, False])
def test_balance_is_kept_where_it_is_switched_on(g1, panel, robot, balance):
    panel._balance.value = balance
    panel._choose()
    for _ in range(30):
        drag(panel, "left_hand", [0.02, 0.0, -0.005])
    state = robot.state()
    only = ("center_of_mass",)
    verdict = g1.check_state(state.positions_by_name, state.base_pose, only)
    assert verdict.passed == balance


def test_collisions_are_avoided_where_that_is_switched_on(g1, panel, robot):
    def collides():
        drag(panel, "left_hand", [0.1, -0.21, 0.1])
        state = robot.state()
        return len(g1.collisions(state.positions_by_name, state.base_pose).pair) > 0

    assert collides()
    panel.change("Undo")
    panel.follow(robot.state())
    panel._avoid.value = True
    panel._prepare()

    def is_ready():
        panel.ui.do_all()
        return panel.posing.is_prepared

    wait_for(is_ready, "the shapes")
    panel._looked = -1.0
    panel.follow(robot.state())
    assert not collides()


def test_what_is_too_far_is_told(g1, panel, robot):
    feet = places(g1, robot)[RIGHT].copy()
    drag(panel, "left_hand", [2.0, 0.0, 0.0])
    assert panel._told.visible
    assert "left_hand is" in panel._told.content.replace("\\", "")
    np.testing.assert_allclose(places(g1, robot)[RIGHT], feet, rtol=0, atol=1e-3)


def test_a_foot_is_moved_by_its_gizmo_or_let_go(g1, panel, robot, clock):
    where = places(g1, robot)
    drag(panel, "left_foot", [0.1, 0.03, 0.08])
    now = places(g1, robot)
    wanted = where[LEFT][:3] + np.array([0.1, 0.03, 0.08])
    np.testing.assert_allclose(now[LEFT][:3], wanted, rtol=0, atol=1e-3)
    np.testing.assert_allclose(now[RIGHT], where[RIGHT], rtol=0, atol=1e-4)
    clock.now += 1.0
    for box in panel._holds.values():
        box.value = False
    panel._choose()
    panel._looked = -1.0
    panel.follow(robot.state())
    before = places(g1, robot)[RIGHT][:3]
    drag(panel, "right_hand", [0.0, -0.8, 0.0])
    assert np.linalg.norm(places(g1, robot)[RIGHT][:3] - before) > 1e-3


def test_changes_are_undone_and_done_again(g1, panel, robot, clock):
    first = robot.state()
    drag(panel, "left_hand", [0.05, 0.0, 0.0])
    drag(panel, "left_hand", [0.05, 0.0, 0.0])
    second = robot.state()
    clock.now += 1.0
    drag(panel, "pelvis", [0.0, 0.0, -0.05])
    third = robot.state()
    for step, wanted in (
        ("Undo", second),
        ("Undo", first),
        ("Redo", second),
        ("Redo", third),
    ):
        panel.change(step)
        now = robot.state()
        np.testing.assert_allclose(now.positions, wanted.positions, atol=1e-12)
        np.testing.assert_allclose(now.base_pose, wanted.base_pose, atol=1e-12)
    with pytest.raises(InvalidValueError, match=r"There is nothing to redo\."):
        panel.change(step)


def test_a_drag_is_one_change_however_long_the_mouse_rests(panel, robot, clock):
    first = robot.state()
    panel._hold("left_hand", True)
    for _ in range(3):
        drag(panel, "left_hand", [0.03, 0.0, 0.0])
        clock.now += 5.0
        panel.follow(robot.state())
    panel._hold("left_hand", False)
    last = robot.state()
    panel._hold("left_hand", True)  # at once
    drag(panel, "left_hand", [0.03, 0.0, 0.0])
    panel._hold("left_hand", False)
    for wanted in (last, first):
        panel.change("Undo")
        np.testing.assert_allclose(
            robot.state().positions, wanted.positions, atol=1e-12
        )


def test_a_mirrored_robot_has_its_hands_exchanged(g1, panel, robot):
    drag(panel, "left_hand", [0.1, 0.1, 0.2])
    before = places(g1, robot)
    panel.change("Mirror")
    after = places(g1, robot)
    flip = [1.0, -1.0, 1.0]
    wanted = before[HAND][:3] * flip
    np.testing.assert_allclose(after["right_rubber_hand"][:3], wanted, atol=2e-3)
    panel.change("Undo")
    np.testing.assert_allclose(places(g1, robot)[HAND], before[HAND], atol=1e-9)


def grab(panel, link, phase, at):
    panel._grab(link, phase, tuple(np.add(at, panel.stage.shift).tolist()))
    search(panel)


def test_any_link_is_grabbed_where_the_mouse_is(g1, panel, robot):
    panel.stage.follow(np.array([0.4, -0.2]))  # the scene has moved below the camera
    elbow = places(g1, robot)["left_elbow_link"].copy()
    tip = np.array([0.02, 0.01, 0.03])
    begin = elbow[:3] + Rotation.from_quat(elbow[3:]).apply(tip)
    feet = [places(g1, robot)[foot].copy() for foot in (LEFT, RIGHT)]
    grab(panel, "left_elbow_link", "start", begin)
    for share in np.linspace(0.0, 1.0, 20):
        grab(
            panel,
            "left_elbow_link",
            "update",
            begin + share * np.array([0.1, 0.05, 0.1]),
        )
    now = places(g1, robot)
    elbow = now["left_elbow_link"]
    there = elbow[:3] + Rotation.from_quat(elbow[3:]).apply(tip)
    goal = begin + np.array([0.1, 0.05, 0.1])
    np.testing.assert_allclose(there, goal, rtol=0, atol=1e-3)
    for foot, pose in zip((LEFT, RIGHT), feet):
        np.testing.assert_allclose(now[foot], pose, rtol=0, atol=1e-4)
    grab(panel, "left_elbow_link", "end", begin)
    grab(panel, "left_elbow_link", "update", begin)  # late
    np.testing.assert_array_equal(places(g1, robot)[LEFT], now[LEFT])
    panel.change("Undo")
    np.testing.assert_allclose(places(g1, robot)[LEFT], feet[0], atol=1e-9)


def test_a_reset_robot_stands_at_its_place(g1, panel, robot):
    turn = Rotation.from_rotvec([0.0, 0.0, 0.5])
    tilted = (turn * Rotation.from_rotvec([0.3, 0.2, 0.0])).as_quat()
    bent = dict.fromkeys(g1.joint_names, 0.2)
    robot.command_all(bent, np.concatenate([[1.0, 2.0, 0.9], tilted]))
    panel.change("Reset")
    state = robot.state()
    names = dict(zip(g1.joint_names, g1.pose("stand")))
    assert state.positions_by_name == pytest.approx(names)
    np.testing.assert_allclose(state.base_pose[:2], [1.0, 2.0], atol=1e-9)
    upright = Rotation.from_quat(state.base_pose[3:]).apply([0.0, 0.0, 1.0])
    np.testing.assert_allclose(upright, [0.0, 0.0, 1.0], atol=1e-9)
    assert g1.check_state(state.positions_by_name, state.base_pose).passed


def test_the_link_is_shown_at_a_target_that_is_not_reached(panel, robot, clock):
    def is_shown():
        ghosts = panel._ghosts.get("left_hand", ())
        return bool(ghosts) and all(mesh.visible for mesh in ghosts)

    drag(panel, "left_hand", [0.05, 0.0, 0.0])
    assert not is_shown()
    drag(panel, "left_hand", [2.0, 0.0, 0.0])
    assert is_shown()
    clock.now += 1.0
    panel._looked = -1.0
    panel.follow(robot.state())
    assert not is_shown()


@pytest.mark.parametrize(
    ("position", "wxyz"),
    [
        ((np.nan, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0)),
        ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 0.0)),
        ((1e300, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0)),
    ],
)
def test_what_no_browser_sends_moves_nothing(panel, robot, position, wxyz):
    before = robot.state()
    gizmo = panel._gizmos["head"]
    gizmo.position, gizmo.wxyz = np.array(position), np.array(wxyz)
    panel._dragged("head")
    np.testing.assert_array_equal(robot.state().positions, before.positions)
    np.testing.assert_array_equal(robot.state().base_pose, before.base_pose)


def test_a_robot_without_such_links_has_no_gizmos():
    text = '<robot name="arm"><link name="a"/></robot>'
    assert roles_of(parse_urdf(text)) == {}


@pytest.mark.slow
def test_a_browser_drags_a_hand(g1, robot):
    world = FileWorld([robot], None)
    show = Show(world, ServerOptions(port=0), lambda _: g1.checker())
    with running(show), PageClient(show.address) as one:
        one.wait_until_whole()
        name = "/map/reach/g1/left_hand"
        one.set("Gizmos", True)
        where = places(g1, robot)
        place, center = where[HAND], center_of(g1, where, HAND)

        def is_shown():
            return np.allclose(one.nodes[name].get("position", 0.0), center)

        one.wait_for(is_shown, "the gizmo on the hand")
        goal = center + np.array([0.05, 0.05, 0.1])
        turn = place[[6, 3, 4, 5]].tolist()
        message = {"wxyz": tuple(turn), "position": tuple(goal.tolist())}
        one.send("TransformControlsUpdateMessage", name=name, owner="", **message)

        def is_there():
            now = center_of(g1, places(g1, robot), HAND)
            return np.allclose(now, goal, atol=1e-3)

        wait_for(is_there, "the hand where it was dragged")


def test_there_is_no_balance_without_a_foot_that_stays(panel):
    for feet in ((True, True), (False, True), (False, False), (True, False)):
        for box, stays in zip(panel._holds.values(), feet):
            box.value = stays
        panel._choose()
        assert panel._balance.disabled == (not any(feet))
