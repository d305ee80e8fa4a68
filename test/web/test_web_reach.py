"""Gizmos on hands, feet and other links, as a browser drags them.

How the body follows is in test/ik/test_drags.py.
"""

from __future__ import annotations

import threading

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from waiting import DEADLINE, wait_for

pytest.importorskip("viser", reason="viser is not installed")

from shown_pages import delete_keyframes, ramp, standing_g1

from g1_description.ik.posing import Posing, roles_of
from g1_description.robot.urdf import parse_urdf
from g1_description.web import keyframes_panel

from page_client import PageClient

pytestmark = pytest.mark.slow

LEFT, RIGHT = "left_ankle_roll_link", "right_ankle_roll_link"
HAND, ELBOW = "left_rubber_hand", "left_elbow_link"
GIZMO = "/map/reach/g1/{}"


@pytest.fixture
def page():
    one = standing_g1()
    one.stand()
    return one


@pytest.fixture
def browser(page):
    """A browser whose gizmos are on their links."""
    with PageClient(page.show.address) as one:
        one.wait_until_whole()
        one.set("Gizmos", True)
        one.set("Arrows along", "the link")
        for foot in ("Left foot stays", "Right foot stays", "Balance"):
            one.set(foot, True)
        wait_until_on(one, page, HAND, "left_hand")
        yield one


def center_of(page, link):
    """Give where the centre of mass of a link is."""
    links = {one.name: one for one in page.model.description.links}
    pose = page.places()[link]
    center = links[link].inertial.center_of_mass
    return pose[:3] + Rotation.from_quat(pose[3:]).apply(center)


def gizmo(browser, role):
    node = browser.nodes[GIZMO.format(role)]
    place = np.array(node.get("position", np.zeros(3)))
    return place, np.array(node.get("wxyz", (1.0, 0.0, 0.0, 0.0)))


def wait_until_on(browser, page, link, role):
    """Wait until a gizmo is on its link, as it is turned."""

    def is_on():
        place, turn = gizmo(browser, role)
        is_turned = abs(np.dot(turn, page.places()[link][[6, 3, 4, 5]])) > 1.0 - 1e-6
        return is_turned and np.allclose(place, center_of(page, link), atol=1e-4)

    browser.wait_for(is_on, f"a gizmo on the {role}")


def drag(browser, role, *ways, turn=None):
    """Press a gizmo, drag it along ways in [m], one after the other, and let go."""
    place, turned = gizmo(browser, role)
    turned = np.array(turned if turn is None else turn).tolist()
    fields = {"name": GIZMO.format(role), "owner": ""}
    browser.send("TransformControlsDragStartMessage", **fields)
    for way in ways:
        place = place + way
        pose = {"position": tuple(place.tolist()), "wxyz": tuple(turned)}
        browser.nodes[fields["name"]].update(pose)  # the server tells all but this one
        browser.send("TransformControlsUpdateMessage", **fields, **pose)
    browser.send("TransformControlsDragEndMessage", **fields)


def wait_until_at(page, link, place):
    """Wait until the centre of a link is at a place."""
    wait_for(lambda: np.allclose(center_of(page, link), place, atol=1e-3), link)


def test_a_hand_is_dragged_the_feet_stay_and_each_drag_is_one_change(page, browser):
    feet = [page.places()[foot] for foot in (LEFT, RIGHT)]
    places = [center_of(page, HAND)]
    for ways in ([[0.05, 0.05, 0.05], [0.0, 0.0, 0.05]], [[0.0, 0.0, -0.04]]):
        drag(browser, "left_hand", *ways)
        places.append(places[-1] + np.sum(ways, axis=0))
        wait_until_at(page, HAND, places[-1])
        wait_until_on(browser, page, HAND, "left_hand")
    for foot, pose in zip((LEFT, RIGHT), feet):
        np.testing.assert_allclose(page.places()[foot], pose, rtol=0, atol=1e-4)
    for change, place in (("Undo", 1), ("Undo", 0), ("Redo", 1), ("Redo", 2)):
        browser.set("Change", change)
        wait_until_at(page, HAND, places[place])
    browser.set("Change", "Redo")
    browser.wait_for(lambda: browser.says("There is nothing to redo."), "a refusal")


def test_the_gizmos_bring_frames_of_the_palms(page, browser):
    """On the hands, with blue, their z axes, where the palms face."""
    names = [name for name in browser.nodes if "/point_" in name]
    for palm, name in zip(page.model.profile.points.values(), names):
        assert name.split("/")[-2] == palm.link
        node = browser.nodes[name]
        assert node["position"] == pytest.approx(palm.point)
        turn = Rotation.from_quat(np.array(node["wxyz"])[[1, 2, 3, 0]])
        assert turn.apply([0.0, 0.0, 1.0]) @ palm.axis > 0.999
        browser.wait_for(lambda node=node: node["visible"], name)
    assert len(names) == 2


def test_gizmos_stay_on_when_a_browser_comes_as_the_last_one_closes(page, monkeypatch):
    seen, left, is_back = threading.Event(), threading.Event(), threading.Event()

    def watch(is_watched):
        (seen if is_watched else left).set()
        assert is_watched or is_back.wait(DEADLINE)

    monkeypatch.setattr(page.show._world, "watch", watch)
    while not left.wait(0.1):  # the browser of another test may count still
        with PageClient(page.show.address):
            seen.wait(1.0)
    seen.clear()
    with PageClient(page.show.address) as browser:
        browser.wait_until_whole()
        browser.set("Gizmos", True)
        browser.set("Arrows along", "the link")
        wait_until_on(browser, page, HAND, "left_hand")
        is_back.set()
        assert seen.wait(DEADLINE)  # the panels were to be left before
        browser.set("Arrows along", "the map")
        hand, upright = browser.nodes[GIZMO.format("left_hand")], [1.0, 0.0, 0.0, 0.0]
        browser.wait_for(lambda: np.allclose(hand["wxyz"], upright), "a turned gizmo")
        assert hand["visible"]


def test_arrows_along_the_map_turn_the_link_from_where_it_is(page, browser):
    browser.set("Arrows along", "the map")
    upright = (1.0, 0.0, 0.0, 0.0)
    browser.wait_for(lambda: np.allclose(gizmo(browser, "left_hand")[1], upright), "it")
    before, pose = center_of(page, HAND), page.places()[HAND]
    turn = Rotation.from_rotvec([0.0, 0.0, 0.2])
    drag(browser, "left_hand", [0.0, 0.0, -0.05], turn=turn.as_quat()[[3, 0, 1, 2]])
    wait_until_at(page, HAND, np.add(before, [0.0, 0.0, -0.05]))
    expected = turn * Rotation.from_quat(pose[3:])

    def is_turned():
        found = Rotation.from_quat(page.places()[HAND][3:])
        return (found.inv() * expected).magnitude() < 1e-2

    wait_for(is_turned, "a turned hand")
    browser.wait_for(lambda: np.allclose(gizmo(browser, "left_hand")[1], upright), "it")


def test_any_link_is_grabbed_where_the_mouse_is(page, browser):
    browser.set("Follow the robot", False)
    elbow = page.places()[ELBOW]
    tip = np.array([0.02, 0.01, 0.03])
    begin = elbow[:3] + Rotation.from_quat(elbow[3:]).apply(tip)
    goal = begin + np.array([0.1, 0.05, 0.1])
    name = next(n for n in [*browser.nodes] if n.endswith(f"/{ELBOW}/visual_0"))

    def send(phase, at):
        at = tuple(at.tolist())
        browser.send(
            "SceneNodeDragMessage",
            phase=phase,
            name=name,
            instance_index=None,
            start_position=at,
            start_screen_pos=(0.5, 0.5),
            end_position=at,
            end_screen_pos=(0.5, 0.5),
            button="left",
            modifier=None,
            owner="",
        )

    send("start", begin)
    for fraction in np.linspace(0.0, 1.0, 10):
        send("update", begin + fraction * (goal - begin))

    def is_there():
        pose = page.places()[ELBOW]
        point = pose[:3] + Rotation.from_quat(pose[3:]).apply(tip)
        return np.allclose(point, goal, atol=1e-3)

    wait_for(is_there, "the elbow below the mouse")
    send("end", goal)
    browser.set("Change", "Undo")
    wait_for(lambda: np.allclose(page.places()[ELBOW], elbow, atol=1e-6), "the elbow")


def test_a_target_out_of_reach_is_reported_and_shows_the_link_there(page, browser):
    name = GIZMO.format("left_hand/target_0")
    drag(browser, "left_hand", [2.0, 0.0, 0.0])
    browser.wait_for(lambda: browser.says("left_hand is"), "the distance")
    browser.wait_for(lambda: name in browser.nodes, "the link at its target")
    wait_until_on(browser, page, HAND, "left_hand")
    browser.wait_for(lambda: not browser.nodes[name].get("visible", True), "none")


@pytest.mark.parametrize(
    ("position", "wxyz"),
    [
        ((np.nan, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0)),
        ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0, 0.0)),
        ((1e300, 0.0, 0.0), (1.0, 0.0, 0.0, 0.0)),
    ],
)
def test_poses_that_no_browser_sends_move_nothing(page, browser, position, wxyz):
    before = page.places()
    fields = {"name": GIZMO.format("head"), "owner": "", "position": position}
    browser.send("TransformControlsUpdateMessage", wxyz=wxyz, **fields)
    browser.set("Left foot stays", False)
    browser.set("Right foot stays", False)
    browser.wait_for(lambda: browser.element("Balance")["disabled"], "what came after")
    np.testing.assert_array_equal(page.places()[HAND], before[HAND])


def test_a_robot_without_such_links_has_no_gizmos():
    text = '<robot name="arm"><link name="a"/></robot>'
    assert roles_of(parse_urdf(text)) == {}


def test_others_are_answered_while_the_page_computes_for_one(
    page, browser, monkeypatch, request
):
    """A drag, a motion of keyframes and a file: all of them last until the end."""
    delete_keyframes(browser)
    begun, gate = [], threading.Event()
    request.addfinalizer(gate.set)

    def endless(kind):
        begun.append(kind)
        assert gate.wait(DEADLINE)
        yield from ()

    def read(*_):
        begun.append("file")
        assert gate.wait(DEADLINE)
        return ramp(1.0)

    search = Posing.search

    def slow_search(*given):
        yield from endless("drag")
        yield from search(*given)

    monkeypatch.setattr(page, "read", read)
    monkeypatch.setattr(Posing, "search", slow_search)
    monkeypatch.setattr(keyframes_panel, "keyframe_pieces", lambda *_: endless("keys"))
    browser.set("Seconds before", 1.0)
    drag(browser, "left_hand", [0.1, 0.0, 0.0])
    for selected in ("1 at 0.00 s", "2 at 1.00 s"):
        browser.set("Keyframe", "Add")
        browser.wait_for(lambda s=selected: browser.value("Selected") == s, selected)
    browser.upload("Open a motion", "walk.csv", b"0.1")
    wait_for(lambda: {*begun} == {"drag", "keys", "file"}, "all of it")
    with PageClient(page.show.address) as other:
        other.wait_until_whole()
        other.press("Go on")
        wait_for(lambda: "go on" in page.simulator.calls, "the simulator")
        other.set("left_knee", 0.5)
        knee = "left_knee_joint"
        wait_for(lambda: page.robot.state().positions_by_name[knee] == 0.5, "a joint")
        other.set("Go to pose", "zero")
        wait_for(lambda: page.robot.state().positions_by_name[knee] == 0.0, "a pose")
        assert not gate.is_set()
    gate.set()
    browser.element("Findings: walk.csv")
