"""The tab History, with the bridge's own history behind it."""

from __future__ import annotations

import threading
from types import SimpleNamespace

import numpy as np
import pytest
from waiting import DEADLINE, wait_for

pytest.importorskip("viser", reason="viser is not installed")
pytest.importorskip("rospy", reason="ROS is not installed")

from shown_pages import ARMS
from web_clients import running

from g1_description import Robot
from g1_description.bridge.recorded_file import write_motion_file
from g1_description.checks.checker import Checker
from g1_description.checks.thresholds import Thresholds
from g1_description.errors import InvalidValueError
from g1_description.motion.files.formats import read_motion
from g1_description.motion.history import History, HistoryPart, gaps_text
from g1_description.robot.state import RobotState
from g1_description.robot.urdf import parse_urdf
from g1_description.ros.history import HistoryClient
from g1_description.ros.waiting import NoAnswerError, RefusedError
from g1_description.sim.standing import standing_base
from g1_description.web.check_thread import CheckThread
from g1_description.web.file_world import FileWorld, StillRobot
from g1_description.web.page import Page
from g1_description.web.plots import TIME
from g1_description.web.saved_motions import check_file_name
from g1_description.web.server.address import ServerOptions
from g1_description.web.ui_loop import UiLoop

from page_client import PageClient

BEYOND = -2.5
"""Of an elbow, in [rad]: its limit is at -2."""


class Past(HistoryClient):
    """Answers from a history in this process, without a master."""

    def __init__(self, history):
        self._history = history
        self.problem, self.may_answer = "", threading.Event()
        self.may_answer.set()

    def part(self, begin=0, end=0, run=0, max_states=0, last=0.0, with_commands=False):
        assert self.may_answer.wait(DEADLINE)
        if self.problem:
            raise NoAnswerError(self.problem)
        runs = self._history.runs()
        run = run or max(runs)
        first, newest = runs[run]
        begin, end = begin or first, end or newest
        if last:
            begin = max(first, newest - round(1e9 * last))
        found = self._history.stretch(begin, end, max_states, run=run)
        if found is None:
            raise RefusedError("There is no such state.")
        commands = self._history.commands(begin, end, run) if with_commands else ()
        note = gaps_text(self._history.gaps(begin, end, run))
        return HistoryPart(
            found, commands, min(runs), max(runs), first, newest, note=note
        )

    def whole(self, begin=0, end=0, run=0, last=0.0):
        return self.part(begin, end, run, last=last)


class Rewound(StillRobot):
    """A robot with a history; it is where its last state is."""

    def __init__(self, name):
        super().__init__(name, parse_urdf(ARMS))
        self._base = super().state().base_pose
        self.record, self.now, self.commands = History(600.0), None, []
        self.history = Past(self.record)

    def add(self, at, position):
        names = tuple(joint.name for joint in self.description.movable_joints)
        values = np.full(len(names), position)
        self.now = RobotState(round(1e9 * at), names, values, base_pose=self._base)
        self.record.add(self.now)

    def state(self):
        return self.now

    def command_all(self, positions, base):
        self.commands.append(dict(positions))


@pytest.fixture
def robots():
    """Two robots, with states from 10 s to 50 s, of which one each is a fault."""
    both = Rewound("one"), Rewound("two")
    for robot, value, fault in zip(both, (0.1, 0.2), (42.0, 30.0)):
        for number in range(801):
            at = 10.0 + 0.05 * number
            is_fault = abs(at - fault) < 0.01
            robot.add(at, BEYOND if is_fault else value + 1e-3 * number)
    return both


@pytest.fixture
def browser(robots, monkeypatch, tmp_path):
    """A browser with the page of both, after a bridge that has ended."""
    monkeypatch.setenv("ROS_HOME", str(tmp_path))
    one = robots[0]
    motion, last = one.record.stretch(0, 50 * 10**9).motion(), "g1_description/last.bag"
    write_motion_file(tmp_path / last, motion, one.description)
    show = Page(
        FileWorld([*robots], lambda path, robot, _: read_motion(path, robot)),
        ServerOptions(port=0),
        lambda robot: Checker(robot, Thresholds()),
    )
    with running(show), PageClient(show.address) as one:
        one.wait_until_whole()
        yield one


def wait_until_shown(browser, time, words=""):
    """Wait until a past time is shown."""
    words = f"Past of {words}" if words else f": {time:.3f} s, key L"
    browser.wait_for(lambda: browser.says(words), f"{time} s")


def go_to(browser, robot, time):
    """Show a time of a robot, by the plots."""
    browser.set("Whose", robot)
    browser.set(TIME, time)


def test_a_robot_is_never_shown_with_the_state_of_another_one(robots, browser):
    one, two = robots
    browser.set("History of", "two")
    browser.press("Check this range")
    found = "30.00 s  position left_elbow"
    browser.element(found)
    browser.set("History of", "one")
    browser.set("State", "-1 s")
    wait_until_shown(browser, 49.0, "one: 49.000 s")
    two.history.problem = "No bridge."
    browser.press(found)
    browser.wait_for(lambda: browser.says("No bridge."), "the problem")
    assert browser.says("Past of one: 49.000 s")
    browser.press("Start here")
    browser.wait_for(lambda: browser.says("Live"), "the present")
    (command,) = one.commands
    assert (
        command["left_elbow_joint"]
        == one.record.stretch(1, 49 * 10**9).positions[-1, 0]
    )
    assert not two.commands
    two.history.problem = ""
    browser.press(found)
    wait_until_shown(browser, 30.0, "two: 30.000 s")


def test_the_history_of_an_ended_bridge_is_a_motion(browser):
    browser.set("Ended bridge", "last.bag")
    browser.wait_for(lambda: browser.says("40.00 s, 801 samples"), "the motion")
    browser.element("32.00 s  position left_elbow")


def test_there_is_nothing_later_than_live(browser):
    for way in ("+1", "+1 s"):
        browser.set("State", way)
    browser.wait_for(lambda: browser.says("Live"), "the present")
    browser.set("State", "-1")
    wait_until_shown(browser, 49.95)
    browser.set("State", "+1")
    wait_until_shown(browser, 50.0)


def test_the_runs_are_those_of_the_robot(robots, browser):
    one, _ = robots
    browser.set("State", "-1 s")
    wait_until_shown(browser, 49.0, "one: 49.000 s")
    for start in (5.0, 3.0):
        for number in range(200):
            one.add(start + 0.01 * number, 0.3)
    wait_until_shown(browser, 49.0, "one: run 1, 49.000 s")
    browser.press("Live")
    browser.wait_for(lambda: browser.says("Live"), "the present")
    browser.set("State", "-1")
    wait_until_shown(browser, 4.98)
    assert [*browser.element("Run")["options"]] == ["1", "2", "3"]
    assert browser.value("Run") == "3"
    browser.set("Run", "2")
    wait_until_shown(browser, 6.99, "one: run 2, 6.990 s")
    browser.set("History of", "two")
    browser.wait_for(lambda: browser.says("Live"), "the present")
    browser.set("State", "-1 s")
    wait_until_shown(browser, 49.0, "two: 49.000 s")
    assert [*browser.element("Run")["options"]] == ["1"]
    browser.set("Back", 0.0)
    browser.wait_for(lambda: browser.says("Live"), "the right end, which is live")


def test_the_checked_range_is_the_time_line_when_the_button_was_pressed(
    robots, browser
):
    one, _ = robots
    one.history.may_answer.clear()
    browser.set("Last seconds", "5")
    browser.press("Check this range")
    browser.element("Findings: 45.0 s to 50.0 s")
    browser.set("Last seconds", "10")
    browser.wait_for(lambda: browser.element("Back")["min"] == -10.0, "10 seconds")
    one.history.may_answer.set()
    fault = "42.00 s  position left_elbow"
    browser.wait_for(lambda: not browser.says("Checking"), "the verdict")
    assert not browser.find(fault)
    browser.press("Check this range")
    browser.element(fault)
    one.add(54.0, 0.5)
    browser.press("Check this range")
    browser.wait_for(
        lambda: browser.says("No states from 50.000 s to 54.000 s."), "a note"
    )
    one.add(54.01, np.nan)
    browser.press("Check this range")
    browser.wait_for(lambda: browser.says("The check failed."), "an error")


def test_an_earlier_check_does_not_replace_the_result_of_a_later_one(
    robots, browser, monkeypatch
):
    one, _ = robots
    check, began, may_end, ended = Checker.check, *(threading.Event() for _ in "123")

    def slow(*arguments):
        began.set()
        assert may_end.wait(DEADLINE)
        verdict = check(*arguments)
        ended.set()
        return verdict

    monkeypatch.setattr(Checker, "check", slow)
    browser.press("Check this range")
    assert began.wait(DEADLINE)
    one.history.problem = "The bridge does not answer."
    browser.press("Check this range")
    browser.wait_for(lambda: browser.says("The check failed."), "the later result")
    may_end.set()
    assert ended.wait(DEADLINE)
    browser.set("Last seconds", "10")  # is done after the verdict has arrived
    browser.wait_for(lambda: browser.element("Back")["min"] == -10.0, "10 seconds")
    assert browser.says("The check failed.")


def test_a_shorter_time_line_is_about_the_shown_time(browser):
    browser.set("State", "-1 s")
    wait_until_shown(browser, 49.0, "one: 49.000 s")
    go_to(browser, "two", 30.0)  # of the same robot
    wait_until_shown(browser, 30.0, "one: 30.000 s")
    browser.set("Last seconds", "10")
    browser.wait_for(lambda: browser.value("Back") == -5.0, "the middle")
    browser.set("Back", 0.0)
    wait_until_shown(browser, 35.0)  # the right end, which is not live


def test_the_beginning_of_the_history_is_reported(browser):
    go_to(browser, "one", 3.0)
    wait_until_shown(browser, 10.0)
    assert browser.says("of run 1 begins at 10")
    browser.press("Live")
    browser.wait_for(lambda: browser.says("Live"), "the present")
    browser.set("Back", -1e9)  # is typed, beyond the range
    wait_until_shown(browser, 20.0)
    assert not browser.says("of run 1 begins")


@pytest.mark.parametrize(
    "name",
    ["", "1", "../x", "x./../../y.csv", "a b", "x.html", "x.", "x.csv.bag", "x/y"],
)
def test_names_of_files_stay_in_the_folder(name):
    with pytest.raises(InvalidValueError, match="Invalid file name"):
        check_file_name(name)
    for good in ("x", "fault_1.csv", "a-b.bag", "b.npz"):
        check_file_name(good)


def test_a_past_state_is_judged_by_the_one_before_it():
    """Not by the one that was shown before: the robot did not stand still."""
    model = Robot()
    names, base = model.joint_names, standing_base(model.description, {})
    bends = [names.index(name) for name in names if "hip_pitch" in name]
    robot = StillRobot("g1", model.description)
    seen, ui = [], UiLoop(SimpleNamespace(), threading.Event())
    checks = CheckThread(
        ui, lambda _: model.checker(), lambda *given: seen.append(given)
    )

    def state(at):
        positions = np.zeros(len(names))
        positions[bends] = -at
        return RobotState(round(1e9 * at), tuple(names), positions, base_pose=base)

    def skipped(*given):
        seen.clear()
        checks.check_state(robot, *given)
        wait_for(lambda: ui.do_all() or seen, "the verdict")
        return "the robot moves" in seen[0][2].skipped.values()

    skipped(state(5.0))
    assert skipped(state(1.0), True, state(0.98))
    assert not skipped(state(0.5), True)  # nobody knows
    assert not skipped(state(6.0))  # live again
    assert skipped(state(6.02))
