"""The panel of the history, with the bridge's own history and service behind it."""

from __future__ import annotations

import sys
import threading
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from robots import robot as chain
from waiting import DEADLINE, wait_for

pytest.importorskip("viser", reason="viser is not installed")
pytest.importorskip("rospy", reason="ROS is not installed")

import viser
from g1_description.srv import GetHistoryRequest

from g1_description import Robot
from g1_description.bridge.history import HistoryServices
from g1_description.errors import InvalidValueError
from g1_description.motion.history import History
from g1_description.robot.state import RobotState
from g1_description.ros.history import HistoryClient
from g1_description.ros.waiting import NoAnswerError, RefusedError
from g1_description.sim.standing import standing_base
from g1_description.web.check_thread import CheckThread
from g1_description.web.file_world import FileWorld, StillRobot
from g1_description.web.history_panel import HistoryPanel
from g1_description.web.library import Library
from g1_description.web.saved_motions import check_file_name
from g1_description.web.server.address import ServerOptions
from g1_description.web.show import Show
from g1_description.web.ui_loop import UiLoop

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "tools"))
from web_clients import running

from page_client import PageClient

BASE = np.array([0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0])


class Direct(HistoryClient):
    """Asks the bridge's service without a master."""

    def __init__(self, robot, history):
        self._services = object.__new__(HistoryServices)
        self._services._status = SimpleNamespace(
            history=history, name=robot.name, description=robot.description
        )
        self.problem, self.may_answer = "", threading.Event()
        self.may_answer.set()

    def _ask(self, **request):
        assert self.may_answer.wait(DEADLINE)
        if self.problem:
            raise NoAnswerError(self.problem)
        answer = self._services._get(GetHistoryRequest(**request))
        if not answer.success:
            raise RefusedError(answer.status_message)
        return answer


class Rewound(StillRobot):
    """A robot with a history; it is where its last state is."""

    def __init__(self, name, description=None):
        super().__init__(name, description or chain("a", "b"))
        self.past, self.now, self.commands = History(600.0), None, []
        self.history = Direct(self, self.past)

    def add(self, at, position):
        names = tuple(joint.name for joint in self.description.movable_joints)
        values = np.full(len(names), position)
        self.now = RobotState(round(1e9 * at), names, values, base_pose=BASE)
        self.past.add(self.now)

    def state(self):
        return self.now

    def command_all(self, positions, base):
        self.commands.append(dict(positions))


@pytest.fixture
def page():
    """A panel of two robots; `settle` runs its loop until something is true."""
    server = viser.ViserServer(host="127.0.0.1", port=0, verbose=False)
    ui = UiLoop(server, threading.Event())
    told, checked = [], []
    ui.tell = lambda text, color="blue": told.append(text)
    robots = Rewound("one"), Rewound("two")
    world = SimpleNamespace(robots=robots, simulator=None)
    checks = SimpleNamespace(check_motion=lambda *given: checked.append(given))
    motion = SimpleNamespace(player=None)
    text = server.gui.add_markdown("")
    panel = HistoryPanel(server.gui, ui, world, checks, motion, text)

    def settle(condition, what):
        def run():
            ui.do_all()
            panel.follow()
            return condition()

        return wait_for(run, what)

    for robot, value in zip(robots, (0.1, 0.2)):
        for number in range(4001):
            robot.add(10.0 + 0.01 * number, value + 1e-4 * number)
    yield SimpleNamespace(
        panel=panel,
        ui=ui,
        robots=robots,
        told=told,
        checked=checked,
        text=text,
        settle=settle,
        shown=lambda: panel.shown and round(panel.shown.state.time, 6),
    )
    server.stop()


def test_a_robot_is_never_shown_with_the_state_of_another_one(page):
    panel, (one, two) = page.panel, page.robots
    panel.step("-1 s")
    page.settle(lambda: page.shown() == 49.0, "a second ago")
    assert panel.past(two) is None
    two.history.problem = "No bridge."
    checked = panel._checked
    checked.robot, checked.run, checked.end, checked.left_at = two, 1, *[50 * 10**9] * 2
    panel._jump(checked, 30.0)
    page.settle(lambda: panel._problem.content, "a problem")
    assert panel.past(two) is None
    assert page.shown() == 49.0
    panel._start()
    page.settle(lambda: panel.shown is None, "live")
    assert not two.commands
    (command,) = one.commands
    assert command["to_b"] == one.past.stretch(1, 49 * 10**9).positions[-1, 0]
    two.history.problem = ""
    panel._jump(checked, 30.0)
    page.settle(lambda: panel.past(two) and page.shown() == 30.0, "the other one")


def test_there_is_nothing_later_than_live(page):
    panel = page.panel
    for way in ("+1", "+1 s"):
        panel.step(way)
    page.settle(lambda: not page.ui.calls.is_busy, "nothing")
    assert panel.shown is None and page.text.content == "**Live**"
    panel.step("-1")
    page.settle(lambda: page.shown() == 49.99, "the state before")
    panel.step("+1")
    page.settle(lambda: page.shown() == 50.0, "the last one")
    assert panel.past(page.robots[0]).before.time < 50.0


def test_steps_add_up_while_the_bridge_is_slow(page):
    panel = page.panel
    may_answer = page.robots[0].history.may_answer
    may_answer.clear()
    for _ in range(5):
        panel.step("-1 s")
    may_answer.set()
    page.settle(lambda: page.shown() == 45.0, "five seconds ago")
    for _ in range(3):
        panel.step("-1")
        time_before = page.shown()
        page.settle(lambda t=time_before: page.shown() < t, "one state back")
    assert page.shown() == 44.97


def test_runs_are_those_of_the_robot(page):
    panel, (one, two) = page.panel, page.robots
    panel.step("-1 s")
    page.settle(lambda: ":** 49.000 s" in page.text.content, "a second ago")
    for start in (5.0, 3.0):
        for number in range(200):
            one.add(start + 0.01 * number, 0.3)
    page.settle(lambda: "run 1, 49.000 s" in page.text.content, "another run")
    panel.live()
    panel.step("-1")
    page.settle(lambda: page.shown() == 4.98, "the newest run")
    assert tuple(panel._runs.options) == ("1", "2", "3")
    assert panel._runs.value == "3"
    panel._runs.value = "2"
    panel._choose_run()
    page.settle(lambda: page.shown() == 6.99, "the end of the second")
    page.settle(lambda: "run 2" in page.text.content, "its number")
    panel._whose.value = "two"
    panel.live()
    panel.step("-1 s")
    page.settle(lambda: panel.past(two), "the other one")
    assert tuple(panel._runs.options) == ("1",)
    panel._back.value = 0.0
    panel._dragged()
    assert panel.shown is None  # its right end is live


def test_what_is_checked_is_the_time_line_when_it_was_pressed(page):
    panel = page.panel
    panel._length.value = "5"
    panel._set_length()
    may_answer = page.robots[0].history.may_answer
    may_answer.clear()
    panel._check()
    panel._length.value = "10"
    panel._set_length()
    may_answer.set()
    page.settle(lambda: page.checked, "a check")
    _, robot, motion, _, _ = page.checked[0]
    assert robot is page.robots[0]
    np.testing.assert_allclose(motion.times[[0, -1]], [45.0, 50.0], rtol=0, atol=1e-9)
    assert "45.0 s to 50.0 s" in panel._findings._folder.label
    page.robots[0].add(50.5, 0.5)
    panel._check()
    page.settle(lambda: page.told, "a note")
    assert page.told == ["No states from 50.000 s to 50.500 s."]
    page.robots[0].add(50.51, np.nan)
    panel._check()
    page.settle(lambda: "failed" in panel._findings._summary.content, "an error")


def test_a_shorter_time_line_is_about_the_shown_time(page):
    panel = page.panel
    panel.step("-1 s")
    page.settle(lambda: page.shown() == 49.0, "a second ago")
    panel.go_to(page.robots[1], 30.0)
    page.settle(lambda: page.shown() == 30.0, "a time of the same robot")
    assert panel.past(page.robots[0])
    panel._length.value = "10"
    panel._set_length()
    assert panel.shown.end == 35 * 10**9 and panel._back.value == -5.0
    panel._back.value = 0.0
    panel._dragged()
    page.settle(lambda: page.shown() == 35.0, "its right end, which is not live")


def test_that_the_history_begins_later_is_told(page):
    panel = page.panel
    panel.go_to(page.robots[0], 3.0)
    page.settle(lambda: page.shown() == 10.0, "the first state")
    assert "of run 1 begins at 10" in panel._problem.content
    panel.live()
    panel._back.value = -1e9  # is typed, beyond the range
    panel._dragged()
    page.settle(lambda: page.shown() == 20.0, "the left end")
    assert panel._problem.content == ""


@pytest.mark.parametrize(
    "name",
    ["", "1", "../x", "x./../../y.csv", "a b", "x.html", "x.", "x.csv.bag", "x/y"],
)
def test_names_of_files_stay_in_the_folder(name):
    with pytest.raises(InvalidValueError, match="Invalid file name"):
        check_file_name(name)
    for good in ("x", "fault_1.csv", "a-b.bag", "b.npz"):
        check_file_name(good)


def test_a_past_state_is_judged_by_the_one_before_it(page):
    """Not by the one that was shown before: the robot did not stand still."""
    model = Robot()
    names, base = model.joint_names, standing_base(model.description, {})
    bends = [names.index(name) for name in names if "hip_pitch" in name]
    robot = StillRobot("g1", model.description)
    seen = []
    checks = CheckThread(
        page.ui, lambda _: model.checker(), lambda *given: seen.append(given)
    )

    def state(at):
        positions = np.zeros(len(names))
        positions[bends] = -at
        return RobotState(round(1e9 * at), tuple(names), positions, base_pose=base)

    def skipped(*given):
        seen.clear()
        checks.check_state(robot, *given)
        page.settle(lambda: seen, "the verdict")
        return "the robot moves" in seen[0][2].skipped.values()

    skipped(state(5.0))
    assert skipped(state(1.0), True, state(0.98))
    assert not skipped(state(0.5), True)  # nobody knows
    assert not skipped(state(6.0))  # live again
    assert skipped(state(6.02))


class Stepped:
    """A simulator that pauses and steps at once."""

    is_paused, is_stand_in, is_kinematic = False, True, True

    def __init__(self):
        self.calls = []

    def status(self):
        return "here"

    def pause(self):
        self.calls.append("pause")

    def step(self, steps):
        self.calls.append(steps)


def test_a_second_browser_is_answered_while_the_first_one_lets_compute(tmp_path):
    """A drag out of reach, five minutes of keyframes, a folder that is being read."""
    model, may_read = Robot(), threading.Event()
    robot = Rewound("g1", model.description)
    stand = dict(zip(model.joint_names, model.pose("stand").tolist()))
    base = standing_base(model.description, stand)
    for at in (10.0, 11.0, 12.0):
        values = np.array([*stand.values()])
        robot.now = RobotState(round(1e9 * at), (*stand,), values, base_pose=base)
        robot.past.add(robot.now)

    def read(*_):
        may_read.wait(DEADLINE)
        raise InvalidValueError("There is no such motion.")

    world, files = FileWorld([robot], read), [tmp_path / "a.csv", tmp_path / "b.csv"]
    world.simulator = simulator = Stepped()
    show = Show(
        world,
        ServerOptions(port=0),
        lambda _: model.checker(),
        Library(tmp_path, files),
    )
    with running(show), PageClient(show.address) as one, PageClient(
        show.address
    ) as other:

        def change(what, count):
            one.set("Keyframe", what)

            def is_done():  # without keyframes, "none" is the one option
                options = one.element("Selected")["options"]
                return options[0] != "none" and len(options) == count

            one.wait_for(is_done, what)

        one.wait_until_whole()
        one.set("Seconds before", 60.0)
        for count in range(1, 7):
            change("Add", count)
        one.set("Gizmos", True)
        turn, away = (1.0, 0.0, 0.0, 0.0), (3.0, 0.0, 1.0)
        hand = {"name": "/map/reach/g1/left_hand", "wxyz": turn, "position": away}
        one.send("TransformControlsUpdateMessage", owner="", **hand)
        wait_for(lambda: robot.commands, "the drag")
        other.press("Pause")
        wait_for(lambda: "pause" in simulator.calls, "the pause")
        other.press("Step")
        wait_for(lambda: 10 in simulator.calls, "the steps")
        other.set("Back", -1.0)
        other.wait_for(
            lambda: any(
                "**Past:** 11" in str(element.get("_markdown"))
                for element in [*other.elements.values()]
            ),
            "the past",
        )
        assert not show.page.motion.motions, "all of it goes on"
        for count in range(5, 0, -1):
            change("Delete", count)
        may_read.set()
