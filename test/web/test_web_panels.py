"""What panels of the page compute, and the ui at which their work is done."""

from __future__ import annotations

import logging
import math
import sys
import threading
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from xml.etree import ElementTree

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from robots import robot
from waiting import DEADLINE, wait_for

pytest.importorskip("viser", reason="viser is not installed")

import viser

from g1_description.checks.verdict import FAILED, WARNING, Finding, Verdict
from g1_description.errors import (
    G1DescriptionError,
    InvalidValueError,
    UnknownNameError,
)
from g1_description.robot import poses as robot_poses
from g1_description.robot.description import Joint
from g1_description.robot.poses import parse_poses
from g1_description.robot.state import RobotState
from g1_description.robot.transform import IDENTITY
from g1_description.web import controls
from g1_description.web import findings_panel as findings
from g1_description.web.controls import JointPanel, slider_range
from g1_description.web.simulator_panel import SimulatorPanel
from g1_description.web.ui_loop import Lane, UiLoop

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "tools"))
from page_client import PageClient

HOSTILE = "</div><script>alert('x')</script> \" onload='y' & <"


def state(positions, commanded=None):
    values = np.array([*positions.values()], dtype=float)
    return RobotState(0, tuple(positions), values, commanded=commanded or {})


class Shown:
    """A robot that is where it was put, and keeps what it is commanded."""

    def __init__(self, *links):
        self.name = "robot"
        self.anchor, self.has_anchors = "", True
        self.description = robot(*(links or ("a", "b", "c")))
        self.commands = []
        self.where = state({"to_b": 0.0, "to_c": 0.0})

    def state(self):
        return self.where

    def command(self, positions):
        self.commands.append(dict(positions))


@pytest.fixture(scope="module")
def server():
    one = viser.ViserServer(host="127.0.0.1", port=0, verbose=False)
    yield one
    one.stop()


@pytest.fixture
def client(server):
    with PageClient(f"http://127.0.0.1:{server.get_port()}") as one:
        one.wait_until_whole()
        wait_for(lambda: len(server.get_clients()) == 1, "the client alone")
        yield one


@pytest.fixture
def ui(server):
    return UiLoop(server, threading.Event())


# --- findings ---


def finding(*intervals, severity=FAILED, subject=("a",), text="too fast"):
    first = intervals[0][0]
    return Finding(
        "velocity",
        severity,
        subject,
        2.0,
        1.0,
        "rad/s",
        first,
        first,
        0.1,
        intervals,
        text,
    )


def bars(*found, span=(0.0, 10.0)):
    """Give the rows of strips: where each bar begins and how long it is, in %."""
    rows = ElementTree.fromstring(findings.strips([[f] for f in found], span))
    return [
        [
            tuple(
                float(part.partition(":")[2].rstrip("%"))
                for part in bar.get("style").split(";")
                if part.startswith(("left", "width"))
            )
            for bar in row
        ]
        for row in rows
    ]


def test_strips_are_where_the_findings_are():
    rows = bars(finding((3.0, 4.0), (6.5, 9.0)), finding((2.0, 12.0)), span=(2.0, 12.0))
    assert rows == [[(10.0, 10.0), (45.0, 25.0)], [(0.0, 100.0)]]


def test_a_moment_is_seen_also_at_the_end():
    least = findings.LEAST_WIDTH
    rows = bars(finding((5.0, 5.0)), finding((10.0, 10.0)))
    assert rows == [[(50.0, least)], [(100.0 - least, least)]]


def test_strips_of_a_single_sample_are_within_the_line():
    ((left, width),) = bars(finding((1.0, 1.0)), span=(1.0, 1.0))[0]
    assert 0.0 <= left <= left + width <= 100.0


@given(st.text(max_size=40))
def test_texts_of_findings_are_text(text):
    # What XML forbids at all is no matter of ours.
    printable = "".join(c for c in text + HOSTILE if c.isprintable())
    row = ElementTree.fromstring(
        findings.strips([[finding((0.0, 1.0), text=printable)]], (0.0, 1.0))
    )
    assert [element.tag for element in row.iter()] == ["div", "div", "i"]
    assert row[0].get("title") == printable
    assert {*row[0].keys()} == {"title", "style"}


def test_a_strip_has_the_colour_of_what_it_means():
    html = findings.strips([[finding((0.0, 1.0), severity=WARNING)]], (0.0, 1.0))
    assert findings.COLORS[WARNING] in html
    assert findings.COLORS[FAILED] not in html


def test_findings_of_one_cause_share_a_strip_and_a_button():
    arm = finding((1.0, 2.0), subject=("l", "r"), text="l in r")
    elbow = replace(finding((1.5, 2.5), subject=("e", "r")), worst=3.0, text="e in r")
    (row,) = ElementTree.fromstring(findings.strips([[arm, elbow]], (0.0, 10.0)))
    assert len(row) == 2
    assert row.get("title") == "e in r, also l - r"
    assert findings.title([arm, elbow]) == "1.50 s  velocity e - r +1"


def test_a_button_tells_its_finding_and_jumps_there(server, client, ui):
    jumps, arm = [], finding((1.0, 2.0), subject=("l", "r"), text="l in r by 3 mm")
    panel = findings.FindingList(server.gui, ui, jumps.append, False)
    panel.show(Verdict("r", (arm,), ("velocity",)), (0.0, 10.0))
    client.press(findings.title([arm]))
    wait_for(lambda: ui.do_all() or jumps, "the click")
    assert jumps == [arm.worst_time]
    assert panel._chosen.content == findings.plain(arm.text)
    panel.begin("other.csv")
    assert panel._chosen.content == ""


def test_a_verdict_in_a_line():
    def told(*severities, **more):
        found = (finding((0.0, 1.0), severity=s) for s in severities)
        found = tuple(replace(f, cause=n) for n, f in enumerate(found))
        return findings.summary(Verdict("r", found, **more))

    assert told(checked=("velocity",)) == "**passed**"
    assert told(FAILED, WARNING, WARNING, checked=("velocity",)) == (
        "**failed**: 1 failure, 2 warnings"
    )
    skipped = {"floating": "there is no base"}
    assert "*Not checked: floating.*" in told(checked=("velocity",), skipped=skipped)
    assert told(skipped=skipped) == (
        "All checks were skipped: floating: there is no base."
    )
    assert findings.title([finding((1.5, 2.0), subject=("l", "r"))]) == (
        "1.50 s  velocity l - r"
    )
    jump = replace(finding((1.5, 2.0), subject=("base",)), check="base_jump")
    assert findings.title([jump]) == "1.50 s  base jump"


# --- sliders ---


@pytest.mark.parametrize(
    ("kind", "limits", "wanted"),
    [
        ("revolute", (-1.0, 2.0), (-1.0, 2.0)),
        ("continuous", (-math.inf, math.inf), (-math.pi, math.pi)),
        ("prismatic", (-math.inf, math.inf), (-1.0, 1.0)),
        ("prismatic", (0.0, math.inf), (0.0, 1.0)),
        ("revolute", (0.5, 0.5), (-math.pi, math.pi)),  # as if it had none
        ("revolute", (4.0, math.inf), (-math.pi, math.pi)),
    ],
)
def test_a_slider_goes_as_far_as_its_joint(kind, limits, wanted):
    joint = Joint("j", kind, "a", "b", IDENTITY, lower=limits[0], upper=limits[1])
    assert slider_range(joint) == wanted


def test_a_value_that_has_just_come_is_not_overwritten_by_an_old_state(
    server, client, ui
):
    shown = Shown()
    panel = JointPanel(server.gui, ui, shown)
    slider = panel._sliders["to_b"]
    panel.follow(shown.where)
    client.set("to_b", 1.25)
    wait_for(lambda: slider.value == 1.25, "the value")
    panel._looked = 0.0
    panel.follow(shown.where)  # before the thread that draws knows of it
    wait_for(lambda: ui.do_all() or shown.commands, "what was wanted")
    assert shown.commands == [{"to_b": 1.25}]
    assert slider.value == 1.25


def test_sliders_show_the_first_state_at_once(server, ui):
    shown = Shown()
    shown.where = state({"to_b": 0.5, "to_c": 0.0})
    panel = JointPanel(server.gui, ui, shown)
    panel.follow(shown.where)
    assert panel._sliders["to_b"].value == 0.5


@pytest.fixture
def clock(monkeypatch):
    """Give a clock of the controls, at 100 s, that stands still."""
    clock = SimpleNamespace(now=100.0)
    fake = SimpleNamespace(monotonic=lambda: clock.now)
    monkeypatch.setattr(controls, "time", fake)
    return clock


def test_an_element_that_was_edited_is_held_for_a_while(clock):
    guard, field = controls.EditGuard(0.7), SimpleNamespace(value=0.0)
    guard.know(field)
    assert not guard.is_held(field)
    field.value = 1.0
    assert guard.is_held(field)
    clock.now += 0.69
    assert guard.is_held(field)
    clock.now += 0.02
    assert not guard.is_held(field)
    guard.hold(field)
    assert guard.is_held(field)
    guard.let_go()
    assert not guard.is_held(field)


def test_a_value_is_sent_if_it_differs_or_a_browser_has_another(clock):
    sent = []

    class Field:
        def __setattr__(self, name, value):
            sent.append(value)
            self.__dict__[name] = value

    guard, field = controls.EditGuard(0.7), Field()
    field.value = 1.0
    guard.show(field, 1.09, 0.1)
    assert sent == [1.0]
    guard.show(field, 1.25, 0.1)
    assert sent == [1.0, 1.25]
    assert not guard.is_held(field), "nobody has edited it"
    guard.hold(field)
    guard.show(field, 1.25)
    assert sent == [1.0, 1.25, 2.25, 1.25]
    guard.hold(field)
    clock.now += 0.5
    guard.hold(field)
    guard.show(field, 1.25)
    assert sent[4:] == [], "no update crossed the last edit; one would undo the next"
    guard.show(field, (1.0, 2.0))
    assert sent[4:] == [(1.0, 2.0)]


def test_the_base_goes_where_it_is_typed_or_dragged_to(server, ui, clock):
    shown, commands = Shown(), []
    shown.command_base = lambda pose: commands.append(pose.tolist())
    panel = controls.BasePanel(server, ui, shown)
    half = math.sqrt(0.5)
    panel._place.value, panel._rpy.value = (1.0, 2.0, 3.0), (0.0, 0.0, math.pi / 2)
    panel._typed()
    np.testing.assert_allclose(commands.pop(), [1, 2, 3, 0, 0, half, half])
    panel._gizmo.position, panel._gizmo.wxyz = (4.0, 5.0, 6.0), (0.0, 2.0, 0.0, 0.0)
    panel._dragged()
    np.testing.assert_allclose(commands.pop(), [4, 5, 6, 1, 0, 0, 0])
    assert panel._place.value == (4.0, 5.0, 6.0)
    np.testing.assert_allclose(np.abs(panel._rpy.value), [math.pi, 0, 0], atol=1e-4)
    panel._gizmo.wxyz = (0.0, 0.09, 0.0, 0.0)
    panel._dragged()
    panel._place.value = (math.nan, 0.0, 0.0)
    panel._typed()
    panel._rpy.value = (0.0, 0.0)
    panel._typed()
    assert not commands


def test_the_anchor_is_set_and_shown_unless_it_is_being_chosen(server, ui, clock):
    shown, chosen = Shown(), []
    shown.set_anchor = chosen.append
    panel = controls.BasePanel(server, ui, shown)
    there = replace(state({"to_b": 0.0}), base_pose=IDENTITY)
    assert panel._anchor.options == ("none", "lowest_foot", "a", "b", "c")
    shown.anchor = "b"
    panel.follow(there)
    assert panel._anchor.value == "b"
    panel._anchor.value = "lowest_foot"
    panel._set_anchor()
    clock.now += 0.11
    panel.follow(there)
    assert panel._anchor.value == "lowest_foot", "it is not answered yet"
    clock.now += 0.71
    panel.follow(there)
    assert panel._anchor.value == "b", "it was refused"
    for has_anchors in (False, True):
        shown.has_anchors = has_anchors
        clock.now += 1.0
        panel.follow(there)
        assert panel._anchor.visible == has_anchors
    panel._anchor.value = "none"
    panel._set_anchor()
    assert chosen == ["lowest_foot", ""]


def test_the_base_is_shown_where_it_is_unless_it_is_edited(server, ui, clock):
    panel = controls.BasePanel(server, ui, Shown())
    assert panel._gizmo.visible is panel.has_gizmo is False
    half = math.sqrt(0.5)
    pose = np.array([1.0, 2.0, 3.00001, 0.0, 0.0, half, half])
    there = replace(state({"to_b": 0.0}), base_pose=pose)
    beside = pose.copy()
    beside[0] += 1.0
    panel.follow(there)
    assert panel._place.value == (1.0, 2.0, 3.0)
    assert panel._rpy.value == (0.0, 0.0, 1.5708)
    assert panel._gizmo.position.tolist() == [0.0, 0.0, 0.0]
    panel._gizmo_on.value = True
    panel._show_gizmo()
    assert panel._gizmo.visible is panel.has_gizmo is True
    other = replace(there, base_pose=beside)
    clock.now += 0.09
    panel.follow(other)
    assert panel._place.value == (1.0, 2.0, 3.0)
    clock.now += 0.02
    panel.follow(other)
    assert panel._place.value == (2.0, 2.0, 3.0)
    np.testing.assert_allclose(panel._gizmo.position, beside[:3])
    np.testing.assert_allclose(panel._gizmo.wxyz, [half, 0, 0, half])
    panel._rpy.value = (0.5, 0.0, 0.0)
    clock.now += 0.11
    panel.follow(there)
    assert panel._place.value == (2.0, 2.0, 3.0)
    clock.now += 0.71
    panel.follow(there)
    assert panel._place.value == (1.0, 2.0, 3.0)
    clock.now += 0.11
    panel.follow(state({"to_b": 0.0}))


# --- poses ---


@pytest.fixture
def poses(server, monkeypatch, tmp_path):
    """Give a panel of poses, whose actions are done by calling them, and its file."""
    file = tmp_path / "poses.yaml"
    file.write_text("low:\n  to_b: 0.5\nother:\n  nose: 0.5\n")
    monkeypatch.setattr(controls, "user_file", lambda: file)
    for module in (controls, robot_poses):
        monkeypatch.setattr(
            module, "read_poses", lambda _: parse_poses(file.read_text(), str(file))
        )
    done = []
    ui = SimpleNamespace(
        on=lambda handle, action: None,
        calls=SimpleNamespace(do=lambda action: action()),
        tell=lambda *words: done.append(words),
    )
    world = SimpleNamespace(move=lambda *given: done.append(given))
    joints = SimpleNamespace(let_go=lambda: done.append("let go"))
    panel = controls.PosePanel(server.gui, ui, world, Shown(), joints)
    return panel, file, done


def test_the_poses_that_fit_are_taken_in_a_time(poses):
    panel, file, done = poses
    assert panel._poses.options == ("low",)
    assert panel._seconds.value == 0.0
    goal = {"to_b": 0.5, "to_c": 0.0}
    for seconds in (0.0, 10.0):
        done.clear()
        panel._seconds.value = seconds
        panel._go()
        assert done == ["let go", (panel._robot, goal, seconds)]
    for seconds in (-0.1, 10.1):
        panel._seconds.value = seconds
        with pytest.raises(InvalidValueError, match="must be from 0 to 10 "):
            panel._go()
    file.write_text("low:\n  nose: 0.5\n")
    with pytest.raises(UnknownNameError, match="nose"):
        panel._go()
    assert len(done) == 2
    empty = controls.PosePanel(panel._gui, panel._ui, None, panel._robot, None)
    assert empty._poses.options == ("none",)


def test_a_pose_is_saved_under_a_new_name_or_where_it_is_wanted(poses):
    panel, file, done = poses
    shown = panel._robot
    shown.where = state({"to_b": 0.25, "to_c": -0.5, "of_somebody_else": 9.0})
    for name, told in (
        (" ", "Enter a name"),
        ("a b", "a b"),
        ("zero", "built-in"),
        ("low", "already exists"),
    ):
        panel._name.value = name
        with pytest.raises(G1DescriptionError, match=told):
            panel._save()
    panel._overwrite.value = True
    panel._save()
    (pose,) = (p for p in controls.read_poses(None).values() if p.name == "low")
    assert pose.positions == {"to_b": 0.25, "to_c": -0.5}
    assert pose.about == "saved in the browser"
    assert panel._overwrite.value is False
    assert done == [(f"Saved pose low in {file}.", "green")]
    panel._name.value = " new "
    panel._save()
    assert panel._poses.options == ("low", "new")
    panel._name.value, shown.where = "third", None
    with pytest.raises(InvalidValueError, match="no state has been received"):
        panel._save()


# --- the simulator ---


class Stepped:
    """A simulator that stands still, whose steps last until they may end."""

    is_paused = is_stand_in = True

    def __init__(self):
        self.calls, self.gate = [], threading.Event()

    def status(self):
        return "paused"

    def step(self, steps):
        self.calls.append(steps)
        assert self.gate.wait(DEADLINE)

    def pause(self):
        self.calls.append("pause")

    def go_on(self):
        self.calls.append("go on")

    def reset(self):
        self.calls.append("reset")

    def hang(self, robot, is_on, length):
        if length > 2.5:
            raise InvalidValueError("no such length")
        self.calls.append((robot, is_on, length))


@pytest.fixture
def stepped(server, client, ui):
    simulator = Stepped()
    panel = SimulatorPanel(server.gui, ui, simulator, "g1", read_only=False)
    yield simulator, panel
    simulator.gate.set()
    wait_for(lambda: not ui.calls.is_busy, "the end")
    server.gui.reset()


@pytest.mark.parametrize(("button", "call"), [("Pause", "pause"), ("Reset", "reset")])
def test_many_steps_end_when_another_button_is_pressed(
    stepped, client, ui, button, call
):
    simulator, _ = stepped
    client.set("Steps", 100_000)
    client.press("Step")
    wait_for(lambda: ui.do_all() or simulator.calls, "the first steps")
    ui.new.clear()
    client.press(button)
    wait_for(ui.new.is_set, "the button")
    ui.do_all()
    simulator.gate.set()
    wait_for(lambda: not ui.calls.is_busy, "the end")
    *steps, last = simulator.calls
    assert last == call
    assert sum(steps) < 1000


def test_as_many_steps_are_done_as_were_wanted(stepped, client, ui):
    simulator, panel = stepped
    client.set("Steps", 1234)
    client.press("Step")
    wait_for(lambda: ui.do_all() or simulator.calls, "the first steps")
    panel.follow()
    assert panel._pause.label == "Pause", "while steps are done"
    simulator.gate.set()
    wait_for(lambda: not ui.calls.is_busy, "the end")
    assert sum(simulator.calls) == 1234
    panel._looked = 0.0
    panel.follow()
    assert panel._pause.label == "Go on"


def test_the_gantry_hangs_the_robot_and_is_off_after_a_refusal(stepped, client, ui):
    simulator, panel = stepped
    client.set("Gantry", True)
    wait_for(lambda: ui.do_all() or simulator.calls, "the rope")
    client.set("Rope", 1.5)
    wait_for(lambda: ui.do_all() or len(simulator.calls) == 2, "a shorter rope")
    assert simulator.calls == [("g1", True, 2.0), ("g1", True, 1.5)]
    client.set("Rope", 3.0)
    wait_for(lambda: ui.do_all() or not panel._hangs.value, "the refusal")


def test_what_the_real_gazebo_does_not_have_is_hidden(stepped, client):
    simulator, panel = stepped
    for is_own in (False, True):
        simulator.is_stand_in = is_own
        panel._looked = 0.0
        panel.follow()
        for label in ("Steps", "Step", "Speed", "Gantry", "Rope"):
            client.wait_for(
                lambda label=label, is_own=is_own: (
                    client.element(label)["visible"] is is_own
                ),
                label,
            )
        assert client.element("Reset")["visible"]


def test_a_step_that_fails_is_the_last_one(server):
    simulator = SimpleNamespace(
        is_paused=True, is_stand_in=True, step=[].index, status=str
    )
    waiting = []
    calls = SimpleNamespace(do=waiting.append)
    ui = SimpleNamespace(on=lambda *_: None, calls=calls)
    panel = SimulatorPanel(server.gui, ui, simulator, "g1", read_only=False)
    panel._steps.value = 1000
    with pytest.raises(ValueError):
        panel._step()
    panel.follow()
    assert (panel._pause.label, waiting) == ("Go on", [])


# --- the ui ---


def test_only_the_newest_of_a_key_is_done_in_the_order_of_the_newest(ui):
    done = []
    for key, number in (("a", 1), ("b", 2), ("a", 3), ("c", 4), ("b", 5)):
        ui.post(key, lambda number=number: done.append(number))
    assert ui.new.is_set()
    assert done == []
    ui.do_all()
    assert done == [3, 4, 5]
    ui.do_all()
    assert done == [3, 4, 5], "each is done once"


def test_what_is_posted_meanwhile_is_done_next_time(ui):
    done = []
    ui.post("a", lambda: ui.post("a", lambda: done.append(2)) or done.append(1))
    ui.do_all()
    assert done == [1]
    ui.do_all()
    assert done == [1, 2]


def told(client):
    """Give all that notices have said."""
    return [element.get("body") for element in list(client.elements.values())]


def fail(error):
    raise error


def test_errors_are_told_and_the_rest_is_done(ui, client, caplog):
    done = []
    ui.post("a", lambda: fail(InvalidValueError("Enter a name for the pose.")))
    ui.post("b", lambda: done.append(2))
    ui.do_all()
    assert done == [2]
    client.wait_for(
        lambda: "Enter a name for the pose." in told(client), "the sentence"
    )
    with caplog.at_level(logging.ERROR):
        ui.guarded(lambda: fail(ZeroDivisionError("of ours")))
    client.wait_for(
        lambda: any("see the log" in str(text) for text in told(client)),
        "the word",
    )
    assert "ZeroDivisionError" in caplog.text


def test_the_same_words_are_told_once(server, ui, client):
    for _ in range(50):
        ui.guarded(lambda: fail(InvalidValueError("Again and again.")))
    ui.guarded(lambda: fail(InvalidValueError("Something else.")))
    client.wait_for(lambda: "Something else." in told(client), "the last one")
    assert told(client).count("Again and again.") == 1


def test_what_waits_is_done_one_after_the_other_and_errors_do_not_end_it(ui, client):
    gate, done, given_back = threading.Event(), [], []
    ui.calls.do(lambda: gate.wait(DEADLINE) and done.append("first"))
    ui.calls.do(lambda: fail(InvalidValueError("Nobody answers.")))
    ui.calls.do(lambda: fail(ValueError("of ours")))
    ui.calls.do(lambda: done.append("last") or 7, given_back.append)
    assert ui.calls.is_busy and done == []
    gate.set()
    wait_for(lambda: not ui.calls.is_busy, "the end")
    assert done == ["first", "last"]
    assert given_back == [], "that is for the thread that draws"
    ui.do_all()
    assert given_back == [7]
    client.wait_for(
        lambda: any("see the log" in str(text) for text in told(client)),
        "the word",
    )


def test_of_one_key_the_newest_is_done_and_others_in_their_order(ui):
    gate, done = threading.Event(), []
    ui.calls.do(lambda: gate.wait(DEADLINE))
    for key, number in (("a", 1), (None, 2), ("a", 3), ("a", 4), (None, 5)):
        ui.calls.do(lambda number=number: done.append(number), key=key)
    gate.set()
    wait_for(lambda: not ui.calls.is_busy, "the end")
    assert done == [2, 4, 5]


@pytest.mark.parametrize(("is_cancelled", "results"), [(False, ["b"]), (True, [])])
def test_pieces_end_where_there_is_something_newer(ui, is_cancelled, results):
    begun, gate, given, lane = threading.Event(), threading.Event(), [], Lane(ui)

    def pieces():
        yield "a"
        begun.set()
        gate.wait(DEADLINE)
        yield "b"
        yield "c"

    lane.go_through(pieces(), given.append, "key")
    assert begun.wait(DEADLINE)
    if is_cancelled:
        lane.cancel("key")
    else:
        lane.go_through(iter(()), given.append, "key")
    gate.set()
    wait_for(lambda: not lane.is_busy, "the end")
    ui.do_all()
    assert given == results
