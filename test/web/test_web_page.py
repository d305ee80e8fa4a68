"""A page of robots without ROS, used by several people over the wire."""

from __future__ import annotations

import math
import threading
import time

import numpy as np
import pytest
from oracle import assert_poses_close, forward_kinematics
from waiting import wait_for

pytest.importorskip("viser", reason="viser is not installed")

from shown_pages import ARMS, Open
from web_clients import running

from g1_description.checks.checker import Checker, LiveCheck
from g1_description.checks.thresholds import Thresholds
from g1_description.errors import InvalidValueError
from g1_description.robot.poses import read_poses
from g1_description.robot.state import RobotState
from g1_description.robot.transform import IDENTITY, compose
from g1_description.robot.urdf import parse_urdf
from g1_description.web import check_thread, ui_loop
from g1_description.web.file_world import FileWorld, StillRobot
from g1_description.web.findings_panel import plain
from g1_description.web.page import Page
from g1_description.web.scene.robot import RED, rgb
from g1_description.web.scene.tree import pose_of
from g1_description.web.server.address import ServerOptions

from page_client import PageClient

pytestmark = pytest.mark.slow

PRECISION = 1e-3
"""In [m] and [rad]: viser sends no change below 1e-5 of a number."""


@pytest.fixture(scope="module")
def shared():
    one = Open()
    yield one
    one.close()


@pytest.fixture
def page(shared):
    """Give the page of all, whose robot is at rest."""
    shared.rest()
    return shared


def place(client, link):
    """Compose the frames above a link."""
    (name,) = (n for n in list(client.nodes) if n.endswith(f"/{link}"))
    parts, pose = name.split("/")[1:], IDENTITY
    for count in range(1, len(parts) + 1):
        node = client.nodes.get("/" + "/".join(parts[:count]), {})
        position = np.array(node.get("position", (0.0, 0.0, 0.0)))
        turn = np.array(node.get("wxyz", (1.0, 0.0, 0.0, 0.0)))
        pose = compose(pose, pose_of(position, turn))
    return pose


def is_at(client, link, pose):
    try:
        assert_poses_close(place(client, link), pose, PRECISION)
    except AssertionError:
        return False
    return True


def placed(page, **positions):
    """Place the robot by scipy."""
    base = page.robot.state().base_pose
    bent = {f"{name}_joint": value for name, value in positions.items()}
    return forward_kinematics(ARMS, base, bent)


def test_a_slider_moves_the_robot_and_follows_whoever_moves_it(page):
    one, other = page.client(), page.client()
    slider = one.element("right_elbow")
    assert (slider["min"], slider["max"]) == (-2.0, 1.614429558)
    one.set("left_elbow", -0.5)
    goal = placed(page, left_elbow=-0.5)
    for client in (one, other):
        client.wait_for(lambda c=client: is_at(c, "left_arm", goal["left_arm"]), "it")
        assert is_at(client, "right_arm", goal["right_arm"])
    other.wait_for(lambda: other.value("left_elbow") == -0.5, "the other slider")
    assert page.position() == -0.5
    page.world.move(page.robot, {"right_elbow_joint": 0.7}, 0.0)
    one.wait_for(lambda: one.value("right_elbow") == 0.7, "the slider")
    one.set("Go to pose", "zero")
    one.wait_for(lambda: one.value("left_elbow") == 0.0, "the slider at zero")
    assert page.position() == 0.0


def test_a_slider_that_was_late_to_hear_shows_the_robot_in_the_end(page, monkeypatch):
    monkeypatch.setattr(ui_loop, "ROUND_TRIP", 1000.0)
    one = page.client()
    page.world.move(page.robot, {"left_elbow_joint": 1.4794}, 0.0)
    one.wait_for(lambda: one.value("left_elbow") == 1.4794, "the slider")
    one.set("left_elbow", -0.5)
    # What was on its way to the browser when the person moved it.
    one.element("left_elbow")["value"] = 1.4794
    one.wait_for(lambda: one.value("left_elbow") == -0.5, "the slider")


def test_nobody_fights_for_a_slider(page):
    one, other = page.client(), page.client()
    pause = threading.Event()
    for sent in np.round(np.linspace(0.0, -1.5, 31), 4).tolist():
        one.set("left_elbow", sent)
        pause.wait(0.02)  # as a hand does
        assert one.value("left_elbow") == sent, "no older value has come"
    other.wait_for(lambda: other.value("left_elbow") == -1.5, "the last value")
    wait_for(lambda: page.position() == -1.5, "the joint")


def test_the_fields_of_the_base_move_it_and_follow(page):
    one, other = page.client(), page.client()
    one.set("x y z", [1.0, 0.5, 0.75])
    other.wait_for(lambda: place(other, "trunk")[0] == 1.0, "the base")
    other.wait_for(lambda: other.value("x y z") == [1.0, 0.5, 0.75], "its fields")
    page.robot.command_base(np.array([0, 0, 2.0, 0, 0, np.sin(0.25), np.cos(0.25)]))
    page.world.changed.set()
    one.wait_for(lambda: one.value("x y z") == [0.0, 0.0, 2.0], "the fields")
    one.wait_for(lambda: one.value("Roll pitch yaw") == [0.0, 0.0, 0.5], "the yaw")


def test_a_robot_that_is_followed_stays_in_the_middle(page):
    one = page.client()
    page.robot.command_base(np.array([7.3, -4.1, 1.0, 0, 0, 0, 1.0]))
    page.world.changed.set()
    one.wait_for(lambda: place(one, "trunk")[0] == 7.3, "the robot far away")
    one.set("Follow the robot", True)

    def is_in_the_middle():
        return np.allclose(place(one, "trunk")[:3], [0, 0, 1.0], atol=PRECISION)

    def has_its_lines_under(x, y):
        lines = np.add(one.nodes["/floor"]["position"][:2], [x, y])
        return np.allclose(lines, np.round(lines), atol=PRECISION)

    one.wait_for(is_in_the_middle, "the robot in the middle")
    one.wait_for(lambda: has_its_lines_under(7.3, -4.1), "the floor under it")
    assert np.abs(one.nodes["/floor"]["position"]).max() < 1.0
    one.set("x y z", [1.0, 2.0, 1.0])
    one.wait_for(lambda: one.value("x y z") == [1.0, 2.0, 1.0], "the fields")
    wait_for(
        lambda: page.robot.state().base_pose[0] == 1.0, "the base where it was put"
    )
    one.wait_for(lambda: has_its_lines_under(1.0, 2.0), "the floor under it")
    one.wait_for(is_in_the_middle, "the robot in the middle again")
    one.set("Gizmo", True)  # a map that moves would carry it away from the mouse
    one.wait_for(lambda: gizmo(one)["visible"], "the gizmo")
    one.set("x y z", [2.0, 2.0, 1.0])
    one.wait_for(
        lambda: np.isclose(place(one, "trunk")[0], 1.0, atol=PRECISION), "its way"
    )
    one.set("Gizmo", False)
    one.wait_for(is_in_the_middle, "the robot in the middle at last")
    one.set("Gizmo", True)
    one.set("Follow the robot", False)
    one.wait_for(lambda: place(one, "trunk")[0] == 2.0, "the robot where it is")
    one.set("Gizmo", False)


def gizmo(client):
    """Give the gizmo of the base."""
    (node,) = (n for name, n in list(client.nodes.items()) if "/gizmos/" in name)
    return node


def test_a_gizmo_that_is_pressed_and_not_dragged_moves_nothing(page):
    one = page.client()
    one.set("Gizmo", True)
    name = gizmo(one)["name"]
    before = page.robot.state().base_pose
    turn, away = (1.0, 0.0, 0.0, 0.0), (5.0, 5.0, 5.0)
    one.send("TransformControlsDragStartMessage", name=name, owner="")
    one.send("TransformControlsDragEndMessage", name=name, owner="")
    one.set("left_elbow", -0.5)
    wait_for(lambda: page.position() == -0.5, "what came after it")
    assert (page.robot.state().base_pose == before).all()
    message = {"name": name, "wxyz": turn, "position": away, "owner": ""}
    one.send("TransformControlsUpdateMessage", **message)
    wait_for(lambda: page.robot.state().base_pose[0] == 5.0, "a base that is dragged")


def test_the_gizmo_of_a_browser_that_was_closed_is_hidden(page):
    one = page.client()
    one.set("Gizmo", True)
    one.wait_for(lambda: gizmo(one)["visible"], "the gizmo")
    page.rest()
    panels = page.show._page.panels
    wait_for(lambda: not any(panel.has_gizmo for panel in panels), "no gizmo")
    other = page.client()
    other.wait_for(lambda: not gizmo(other)["visible"], "no gizmo")
    assert other.value("Gizmo") is False


@pytest.mark.parametrize(
    ("label", "value"),
    [
        ("x y z", [math.nan, 0.0, 0.0]),
        ("x y z", [1e300, 0.0, 1.0]),
        ("Roll pitch yaw", [0.0, 0.0]),
        ("Go to pose", "nobody's"),
        ("Anchor", "nobody's"),
    ],
)
def test_values_that_no_browser_sends_move_nothing(page, label, value):
    one = page.client()
    before = page.robot.state().base_pose
    uuid = one.element(label)["uuid"]
    one.send("GuiUpdateMessage", uuid=uuid, updates={"value": value})
    one.set("left_elbow", -0.5)
    wait_for(lambda: page.position() == -0.5, "what came after it")
    assert (page.robot.state().base_pose == before).all()


def test_the_anchor_is_shown_and_set_and_a_refused_one_taken_back(page):
    one, robot = page.client(), page.robot
    options = ["none", "lowest_foot", *robot.description.link_names]
    assert [*one.element("Anchor")["options"]] == options
    robot.set_anchor("left_arm")
    page.world.changed.set()
    one.wait_for(lambda: one.value("Anchor") == "left_arm", "its anchor")
    one.set("Anchor", "trunk")
    wait_for(lambda: robot.anchor == "trunk", "the chosen anchor")
    one.set("Anchor", "lowest_foot")
    one.wait_for(lambda: one.value("Anchor") == "trunk", "the anchor that stays")
    assert one.says("has no feet")
    one.set("Anchor", "none")
    wait_for(lambda: not robot.anchor, "no anchor")


def names_shown(client):
    """Give the names of links that are shown."""
    return {
        node["text"]
        for name, node in list(client.nodes.items())
        if name.endswith("/picked")
    }


def click(client, link):
    """Click a link's first shape."""
    (name,) = (n for n in list(client.nodes) if n.endswith(f"/{link}/visual_0"))
    client.send(
        "SceneNodeClickMessage",
        name=name,
        instance_index=None,
        ray_origin=(1.0, 0.0, 0.0),
        ray_direction=(-1.0, 0.0, 0.0),
        screen_pos=(0.5, 0.5),
        modifier=None,
        owner="",
    )


def test_a_click_shows_the_name_of_a_link_to_all(page):
    one, other = page.client(), page.client()
    for link, names in (("right_arm", {"right_arm"}), ("trunk", {"trunk"})):
        click(one, link)
        for client in (one, other):
            client.wait_for(lambda c=client, n=names: names_shown(c) == n, link)
    click(other, "trunk")
    one.wait_for(lambda: names_shown(one) == set(), "no name")


NONSENSE = [math.nan, math.inf, -math.inf, 1e300, -3.0, "0.5 rad", None, [1.0], {}, b""]


def test_nonsense_moves_nothing_and_the_page_goes_on():
    page = Open()
    one, other = page.client(), page.client()
    before = page.robot.state()
    for label in (
        "left_elbow",
        "x y z",
        "Roll pitch yaw",
        "Seconds",
        "Go to pose",
        "Name",
    ):
        uuid = one.element(label)["uuid"]
        for value in (*NONSENSE, [math.nan] * 3, [1e300] * 3, ["a"] * 3, [1.0, 2.0]):
            one.send("GuiUpdateMessage", uuid=uuid, updates={"value": value})
    # The newest of each field counts: a place too far away, with whole angles.
    for label, value in (("Roll pitch yaw", [0.0] * 3), ("x y z", [1e300, 0.0, 1.0])):
        uuid = one.element(label)["uuid"]
        one.send("GuiUpdateMessage", uuid=uuid, updates={"value": value})
    one.send("GuiUpdateMessage", uuid="of nothing", updates={"value": 1.0})
    one.send("TransformControlsUpdateMessage", name="/none", wxyz=[9], position=[])
    other.set("right_elbow", -0.25)
    wait_for(lambda: page.position("right_elbow_joint") == -0.25, "others")
    after = page.robot.state()
    assert after.positions_by_name == {
        **before.positions_by_name,
        "right_elbow_joint": -0.25,
    }
    assert (after.base_pose == before.base_pose).all()
    third = page.client()
    third.wait_for(lambda: third.value("left_elbow") == 0.0, "a slider that is whole")
    third.wait_for(lambda: len(third.value("x y z")) == 3, "three numbers")
    third.wait_for(lambda: np.isfinite(third.value("x y z")).all(), "whole fields")
    assert not other.has_ended
    page.close()


def test_who_may_only_look_changes_nothing():
    page = Open(read_only=True)
    try:
        client = page.client()
        before = page.robot.state().positions_by_name
        labels = {e.get("label") for e in list(client.elements.values())}
        assert not labels & {"left_elbow", "Go to pose", "Save pose", "x y z"}
        values = list(client.elements)
        for uuid in values:
            for value in (True, 0.5, "zero"):
                client.send("GuiUpdateMessage", uuid=uuid, updates={"value": value})
        page.world.move(page.robot, {"right_elbow_joint": 0.5}, 0.0)
        goal = placed(page, right_elbow=0.5)["right_arm"]
        client.wait_for(lambda: is_at(client, "right_arm", goal), "what others do")
        assert page.robot.state().positions_by_name == {
            **before,
            "right_elbow_joint": 0.5,
        }
        assert not client.has_ended
    finally:
        page.close()


def test_links_that_collide_are_red(page):
    client = page.client()

    def red():
        return {
            name.split("/")[-2]
            for name, node in list(client.nodes.items())
            if "/visual_" in name and tuple(node["color"]) == rgb(RED)
        }

    client.wait_for(lambda: not red(), "links in their own colours")
    client.set("left_elbow", -1.5)
    client.set("right_elbow", 1.5)
    client.wait_for(lambda: red() == {"left_arm", "right_arm"}, "two red links")
    client.wait_for(lambda: client.says("left_arm"), "a sentence on it")
    for is_checked, links in ((False, set()), (True, {"left_arm", "right_arm"})):
        client.set("Checks", is_checked)
        client.wait_for(lambda now=links: red() == now, f"the links {links} in red")
    client.set("left_elbow", 0.0)
    client.wait_for(lambda: not red(), "links in their own colours")


def test_a_motion_is_scrubbed_judged_and_clicked(page):
    client = page.client()
    client.upload("Open a motion", "walk.csv", b"0.1")
    client.wait_for(lambda: client.element("Time")["visible"], "the time line")
    assert (client.element("Time")["min"], client.element("Time")["max"]) == (0.0, 3.0)
    client.set("Time", 2.0)
    wait_for(lambda: page.position() == pytest.approx(-0.6), "the time")
    client.set("Time", math.nan)
    client.set("Sample", "last")
    wait_for(lambda: page.position() == pytest.approx(-0.9), "the last sample")
    client.wait_for(lambda: client.element("Findings: walk.csv"), "the findings")


def test_a_pose_is_saved_under_a_new_name_or_over_another_one_and_taken(
    page, tmp_path, monkeypatch
):
    monkeypatch.setenv("ROS_HOME", str(tmp_path))
    one = page.client()
    one.set("left_elbow", 1.614429558)
    wait_for(lambda: page.position() == 1.614429558, "the limit")
    for name, problem in ((" ", "Enter a name"), ("a b", "a b"), ("zero", "built-in")):
        one.set("Name", name)
        one.press("Save pose")
        one.wait_for(lambda p=problem: one.says(p), problem)
    one.set("Name", " high ")
    one.press("Save pose")
    one.wait_for(lambda: "high" in one.element("Go to pose")["options"], "the button")
    one.set("left_elbow", 0.0)
    wait_for(lambda: page.position() == 0.0, "a move away")
    one.set("Go to pose", "high")
    wait_for(lambda: page.position() == pytest.approx(1.614429558), "the pose")
    one.set("Seconds", 0.1)
    one.set("Go to pose", "zero")
    wait_for(lambda: page.position() == 0.0, "the pose on its way")
    one.set("Seconds", 10.1)
    one.set("Go to pose", "high")
    one.wait_for(lambda: one.says("must be from 0 to 10 "), "a refusal")
    one.set("Name", "high")
    one.press("Save pose")
    one.wait_for(lambda: one.says("already exists"), "a refusal")
    one.set("Overwrite", True)
    one.press("Save pose")
    one.wait_for(lambda: one.value("Overwrite") is False, "another pose of that name")
    pose = read_poses(page.robot.description)["high"]
    assert pose.positions == {"left_elbow_joint": 0.0, "right_elbow_joint": 0.0}


# --- the simulator ---


@pytest.mark.parametrize(("button", "call"), [("Pause", "pause"), ("Reset", "reset")])
def test_many_steps_end_when_another_button_is_pressed(page, button, call):
    one, simulator = page.client(), page.simulator
    simulator.gate.clear()
    one.set("Steps", 100_000)
    one.press("Step")
    wait_for(lambda: simulator.calls, "the first steps")
    one.wait_for(lambda: one.find("Pause"), "the label while steps are done")
    if button == "Reset":  # the one of the world; Reach, with another one, is not there
        assert one.element("Reset")["color"] == "orange"
    one.press(button)
    one.set("left_elbow", -0.5)
    wait_for(lambda: page.position() == -0.5, "what came after it")
    simulator.gate.set()
    wait_for(lambda: simulator.calls[-1] == call, "the button")
    assert sum(simulator.calls[:-1]) < 1000
    one.wait_for(lambda: one.find("Go on"), "the pause")


def test_as_many_steps_are_done_as_were_entered_or_none_after_an_error(page):
    one, simulator = page.client(), page.simulator
    one.set("Steps", 1234)
    one.press("Step")
    wait_for(lambda: sum(simulator.calls) == 1234, "the steps")
    simulator.problem = "The simulator has gone."
    one.press("Step")
    one.wait_for(lambda: one.says(simulator.problem), "the error")
    simulator.problem = None
    one.wait_for(lambda: one.find("Go on"), "the pause")
    assert sum(simulator.calls) == 1334, "one slice"


def test_the_gantry_hangs_the_robot_and_is_off_after_a_refusal(page):
    one, simulator = page.client(), page.simulator
    one.set("Gantry", True)
    wait_for(lambda: simulator.calls == [("arms", True, 2.0)], "the rope")
    one.set("Rope", 1.5)
    wait_for(lambda: simulator.calls[1:] == [("arms", True, 1.5)], "a shorter rope")
    one.set("Rope", 3.0)
    one.wait_for(lambda: not one.value("Gantry"), "the refusal")


def test_what_the_real_gazebo_does_not_have_is_hidden(page):
    one, simulator = page.client(), page.simulator
    for is_own in (False, True):
        simulator.is_stand_in = is_own
        for label in ("Steps", "Step", "Speed", "Gantry", "Rope"):
            one.wait_for(
                lambda n=label, now=is_own: one.element(n)["visible"] is now, label
            )
        assert one.element("Reset")["visible"]


def test_checks_that_cannot_be_prepared_are_tried_again_seldom(monkeypatch):
    monkeypatch.setattr(check_thread, "AGAIN", 0.5)
    tries = []

    def make(robot):
        tries.append(time.monotonic())
        if len(tries) < 3:
            raise InvalidValueError("The checks have no room.")
        return Checker(robot, Thresholds())

    page = Open(make)
    client = page.client()  # and the robot stands still
    client.wait_for(lambda: client.says("nothing found"), "a verdict at last")
    assert len(tries) == 3
    assert np.diff(tries).min() >= 0.5
    page.close()


def test_a_robot_without_joints_is_shown():
    description = parse_urdf('<robot name="r"><link name="a"/></robot>')
    world = FileWorld([StillRobot("r", description)], lambda *_: None)
    show = Page(world, ServerOptions(port=0), lambda robot: Checker(robot, None))
    show.stop()
    show.run()


LINKS = ("trunk", "trunk/left_arm", "trunk/right_arm")
SWITCHES = {
    "Visual shapes": {f"/map/robots/arms/{link}/visual_0" for link in LINKS},
    "Collision shapes": {f"/map/robots/arms/{link}/collision_0" for link in LINKS},
    "Frames": {f"/map/robots/arms/{link} axes" for link in LINKS},
    "Names of links": {f"/map/robots/arms/{link}/name" for link in LINKS},
    "Floor": {"/floor"},
    "Axes of the map": {"/map/axes"},
}


def looks(client):
    """List the nodes of the switches that are visible, and whose axes are."""
    nodes = list(client.nodes.items())
    shown = {name for name, node in nodes if node.get("visible", True)}
    axes = {f"{name} axes" for name, node in nodes if node.get("show_axes")}
    return (shown | axes) & set().union(*SWITCHES.values())


@pytest.mark.parametrize("label", SWITCHES)
def test_a_switch_shows_and_hides_what_it_names(page, label):
    one = page.client()
    is_on, before = one.value(label), looks(one)
    for on in (not is_on, is_on):
        one.set(label, on)
        shown = before if on == is_on else before ^ SWITCHES[label]
        one.wait_for(lambda w=shown: looks(one) == w, label)


class Given(StillRobot):
    """A robot in the state that a test gives it."""

    given = None

    def state(self):
        return self.given


def test_a_state_has_the_findings_that_the_node_checker_reports():
    robot = Given("arms", parse_urdf(ARMS))
    checker = Checker(robot.description, Thresholds())
    node = LiveCheck(checker)
    names = tuple(joint.name for joint in robot.description.movable_joints)
    up, away = np.array([[0, 0, 3, 0, 0, 0, 1], [1, 0, 3, 0, 0, 0, 1]], dtype=float)
    show = Page(FileWorld([robot], None), ServerOptions(port=0), lambda _: checker)
    with running(show), PageClient(show.address) as one:
        for at, base, rate, found in (
            (1.0, up, 0.0, {"floating"}),
            (1.1, away, 0.0, set()),  # it moves
            (2.0, away, 0.0, {"floating"}),  # it has stopped there
            (3.0, away, 99.0, {"floating", "velocity"}),
        ):
            rates = np.array([rate, 0.0])
            state = RobotState(round(1e9 * at), names, np.zeros(2), rates, base)
            verdict = node.check(state)
            assert {finding.check for finding in verdict.findings} == found
            robot.given = state
            lines = [plain(finding.text) for finding in verdict.findings]
            lines = [f"- {line}" for line in lines] or ["nothing found."]

            def is_listed(lines=lines):
                texts = [str(e.get("_markdown")) for e in [*one.elements.values()]]
                now = [text for text in texts if text.startswith("**Configuration now")]
                return now and all(line in now[0] for line in lines)

            one.wait_for(is_listed, f"the findings at {at} s")
