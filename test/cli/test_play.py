"""The keys that play reads, and what it does when it is ended, without a robot."""

import contextlib
import os
import pty
import termios
import threading
import time
from dataclasses import replace
from types import SimpleNamespace

import pytest

pytest.importorskip("rospy", reason="rospy is not installed")

import numpy as np
import rospy
from checked import POST, post_motion, write_motions
from g1_description.srv import PlayMotionResponse
from waiting import wait_for

from g1_description.cli import play
from g1_description.cli.play import Keyboard, PlayOptions
from g1_description.command_line import parse
from g1_description.errors import InvalidValueError
from g1_description.motion.files import table
from g1_description.motion.motion import Motion
from g1_description.robot.urdf import parse_urdf
from g1_description.ros import playing as sessions
from g1_description.ros.playing import MotionClient, Session

SOON = 0.05
"""[s] A wait for what does not come."""


@pytest.fixture
def ends():
    """Give both ends of a terminal, the person's first."""
    ours, its = pty.openpty()
    yield ours, its
    for end in (ours, its):
        with contextlib.suppress(OSError):  # closed already
            os.close(end)


@pytest.fixture
def keyboard(ends):
    """Give a keyboard at that terminal."""
    made = Keyboard(ends[1])
    yield made
    made.close()


def keys(keyboard, count):
    return [keyboard.next_key(10.0) for _ in range(count)]


def test_keys_that_come_together_are_read_one_by_one(ends, keyboard):
    os.write(ends[0], b"\x1b[C\x1bOC\x1bOD q")
    assert keys(keyboard, 5) == ["right", "right", "left", "space", "q"]
    assert keyboard.next_key(SOON) == ""


def test_other_keys_are_skipped_whole(ends, keyboard):
    os.write(ends[0], b"x\x1b[1;5C\x1b[A\xc3\xa4\x1b[15~\x1bOq \x1bq")
    assert keys(keyboard, 2) == ["space", "q"]


def test_a_terminal_that_is_gone_ends_it(ends, keyboard):
    os.close(ends[0])
    assert keyboard.next_key(10.0) == "q"
    assert keyboard.next_key(10.0) == "q"


def test_the_terminal_is_as_it_was(ends):
    before = termios.tcgetattr(ends[1])
    keyboard = Keyboard(ends[1])
    assert termios.tcgetattr(ends[1]) != before
    keyboard.close()
    keyboard.close()
    assert termios.tcgetattr(ends[1]) == before


def test_without_a_terminal_there_are_no_keys():
    keyboard = Keyboard(None)
    assert keyboard.next_key(0.0) == ""
    keyboard.close()


class Bridge:
    """Notes what it is asked; may do something before it answers."""

    resolved_name, answer = "/play_motion", ""

    def __init__(self, robot):
        self.calls, self.meanwhile, self._robot = [], lambda: None, robot
        self.motions = []

    def __call__(self, motion):
        moves = bool(motion.joint_trajectory.points)
        self.calls.append("play" if moves else "stop")
        if moves:
            self.motions.append(
                [
                    (p.time_from_start.to_sec(), p.positions[0], *p.velocities)
                    for p in motion.joint_trajectory.points
                ]
            )
            self.meanwhile()
        start = rospy.Time(nsecs=self._robot.now_ns)
        return PlayMotionResponse(True, self.answer, start)


class Robot:
    """A robot behind a bridge; its time is set."""

    def __init__(self):
        self.now_ns = 0
        self.bridge = Bridge(self)
        self.motions = MotionClient(self.bridge)

    def look_after_time(self):
        pass


@pytest.fixture
def robot():
    return Robot()


@pytest.fixture
def session(robot):
    """Give a motion of two seconds."""
    times = np.array([0.0, 1.0, 2.0])
    motion = Motion(times, ("knee",), times[:, None], None, None)
    return Session(robot, motion, 1.0, print)


def leave_meanwhile(robot):
    """End it from another thread before the robot answers; give the thread."""
    thread = threading.Thread(target=robot.motions.leave)

    def begin():
        thread.start()
        wait_for(lambda: robot.motions.is_left, "the other thread")

    robot.bridge.meanwhile = begin
    return thread


def test_the_robot_is_stopped_while_the_bridge_is_asked_to_begin(robot, session):
    thread = leave_meanwhile(robot)
    session.start()
    thread.join()
    assert robot.bridge.calls == ["play", "stop"]


def test_the_robot_is_stopped_while_it_is_asked_to_go_on(robot, session):
    session.start()
    session.toggle()
    thread = leave_meanwhile(robot)
    session.toggle()
    thread.join()
    assert robot.bridge.calls == ["play", "stop", "play", "stop"]


def test_the_robot_is_stopped_while_it_is_asked_to_begin_again(
    robot, session, monkeypatch
):
    monkeypatch.setattr(sessions, "REST", 0.0)
    session.start()
    robot.now_ns = 3 * 10**9
    assert session.is_over
    thread = leave_meanwhile(robot)
    session.restart_when_rested()
    thread.join()
    assert robot.bridge.calls == ["play", "play", "stop"]


def test_nothing_begins_after_the_end(robot, session):
    assert not robot.motions.leave()
    with pytest.raises(rospy.ROSInterruptException):
        session.start()
    assert robot.bridge.calls == []


def test_a_robot_at_its_end_is_not_stopped(robot, session):
    session.start()
    robot.now_ns = 3 * 10**9
    assert session.is_over
    assert not robot.motions.leave()
    assert robot.bridge.calls == ["play"]


def test_changes_by_the_bridge_are_reported_once(robot, session, capsys):
    session.start()
    assert capsys.readouterr().out == ""
    robot.bridge.answer = "clamped"
    for _ in range(2):
        session.toggle()
        session.toggle()
    assert capsys.readouterr().out == "clamped.\n"


def test_each_end_has_its_rest(robot, session, monkeypatch):
    """Also after a pause in the rest before."""
    session.start()
    robot.now_ns = 3 * 10**9
    session.restart_when_rested()
    session.toggle()
    session.toggle()
    robot.now_ns = 6 * 10**9
    assert session.is_over
    calls, end = len(robot.bridge.calls), time.monotonic()
    wait_for(lambda: time.monotonic() > end + SOON, "a while")
    monkeypatch.setattr(sessions, "REST", SOON)
    session.restart_when_rested()
    assert len(robot.bridge.calls) == calls
    wait_for(
        lambda: session.restart_when_rested() or robot.bridge.calls[calls:], "a rest"
    )


def lead_in(robot, times, seconds):
    """Give a session of a motion at some times that is led in, from rest."""
    positions = np.arange(len(times), dtype=float)[:, None]
    motion = Motion(np.array(times), ("knee",), positions, positions + 1.0, None)
    return Session(robot, motion, 1.0, print, seconds)


def test_a_single_sample_is_over_when_the_robot_is_there(robot):
    session = lead_in(robot, [0.0], 3.0)
    session.start()
    assert robot.bridge.motions[-1] == [(3.0, 0.0, 0.0)]
    assert not session.is_over
    robot.now_ns = 3 * 10**9
    assert session.is_over
    assert not robot.motions.leave()


def test_the_robot_is_stopped_on_its_way_to_a_single_sample(robot):
    lead_in(robot, [0.0], 3.0).start()
    assert robot.motions.leave()
    assert robot.bridge.calls == ["play", "stop"]


@pytest.mark.parametrize("begin", [0.0, 100.0])
def test_a_motion_is_led_in_to_a_rest_and_then_goes_on_as_it_is(robot, begin):
    session = lead_in(robot, [begin, begin + 1.0, begin + 2.0], 0.5)
    session.start()
    assert robot.bridge.motions == [[(0.5, 0.0, 0.0), (1.5, 1.0, 2.0), (2.5, 2.0, 3.0)]]
    robot.now_ns = 10**9
    assert session.time == begin + 0.5
    session.toggle()
    session.toggle()
    first, *_ = robot.bridge.motions[-1]
    assert first[0] == 0.0
    robot.now_ns = 3 * 10**9
    assert session.is_over


def test_steps_on_the_way_to_the_beginning_are_led_in(robot):
    session = lead_in(robot, [0.0, 1.0, 2.0], 0.5)
    session.start()
    session.step(1)
    assert [time for time, *_ in robot.bridge.motions[-1]] == [0.5]
    robot.now_ns = 10**9
    session.step(1)
    assert [time for time, *_ in robot.bridge.motions[-1]] == [0.0]


@pytest.mark.parametrize(
    ("words", "told"),
    [
        ([], "play: none.csv does not exist"),
        (["--speed", "0"], "--speed: must be a number from"),
        (["--speed", "1e9"], "--speed: must be a number from"),
        (["--fps", "1e12"], "must be greater than 0 and at most 1e+06"),
        (["--to", "2"], "unrecognized arguments: --to 2 (did you mean --until?)"),
    ],
)
def test_a_wrong_command_line_ends_with_a_sentence(words, told, capsys):
    with pytest.raises(SystemExit) as end:
        play.main(parse(PlayOptions, "play", ["none.csv", *words]))
    assert end.value.code == 2
    assert told in capsys.readouterr().err


@pytest.mark.parametrize(
    ("time", "sample", "speed", "running", "shown"),
    [
        (1.0, 1, 1.0, True, "[{0}]   1.00 of 3.00 s  sample 1 of 9"),
        (2.0, 5, 2.5, True, "[{1}]   2.00 of 3.00 s  sample 5 of 9  x 2.5"),
        (3.0, 9, 1.0, False, "[{2}]   3.00 of 3.00 s  sample 9 of 9  paused"),
    ],
)
def test_a_bar_tells_how_far_it_is(time, sample, speed, running, shown):
    session = SimpleNamespace(
        begin=1.0,
        end=3.0,
        time=time,
        sample=sample,
        motion=SimpleNamespace(times=range(9)),
        is_running=running,
    )
    bars = ["." * play.BAR, "#" * (play.BAR // 2) + "." * (play.BAR // 2)]
    assert play.progress(session, speed) == shown.format(*bars, "#" * play.BAR)
    session.begin = 3.0  # a single sample
    assert play.progress(session, 1.0).startswith(f"[{'#' * play.BAR}]")


LIFT = np.array([0.0, 0.0, 0.25, 0.0, 0.0, 0.0, 0.0])


def test_a_motion_is_cut_and_moved_as_requested(tmp_path, capsys, monkeypatch):
    (file,) = write_motions(tmp_path, 0.5)
    pose = np.array([1.0, 2.0, 0.5, 0.0, 0.0, 1.0, 0.0])
    view = SimpleNamespace(
        description=parse_urdf(POST), state=SimpleNamespace(base_pose=pose)
    )

    def prepared(*words):
        _, played = play.prepare(parse(PlayOptions, "play", [str(file), *words]), view)
        return played

    plain = prepared("--from", "0.2", "--until", "0.6")
    assert plain.times[[0, -1]].tolist() == pytest.approx([0.2, 0.6])
    assert capsys.readouterr().out == ""
    here = prepared("--start-here")
    np.testing.assert_allclose(here.base_poses[0][:2], pose[:2], atol=1e-9)
    np.testing.assert_allclose(np.abs(here.base_poses[0][5]), 1.0, atol=1e-9)
    lifted = replace(post_motion(), base_poses=post_motion().base_poses + LIFT)
    file.write_bytes(table.write(lifted, None, None)[0])
    low = prepared("--on-floor")
    assert low.base_poses[0][2] == pytest.approx(0.05)
    told = capsys.readouterr().out
    assert told == "play: moved the motion by -0.2500 m in height.\n"
    file.write_bytes(
        table.write(replace(post_motion(), base_poses=None), None, None)[0]
    )
    assert prepared().base_poses is None
    for words in (["--start-here"], ["--on-floor"], ["--start-here", "--on-floor"]):
        with pytest.raises(InvalidValueError) as refused:
            prepared(*words)
        assert str(refused.value) == (
            f"{' and '.join(words)} needs a motion with a base, which motion0.csv "
            "lacks."
        )
