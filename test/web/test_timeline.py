"""Time lines of the past: their ends, requests and titles."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from g1_description.motion.history import HistoryPart
from g1_description.motion.history_chunks import Stretch
from g1_description.robot.state import RobotState
from g1_description.web.timeline import SECOND, Timeline

ROBOT = SimpleNamespace(name="r")


def part(*seconds, run=1, last_run=1, last=50):
    """Give an answer with states at some times, in [s]."""
    stamps = np.array([round(SECOND * at) for at in seconds], dtype=np.int64)
    positions = np.zeros((len(stamps), 1))
    stretch = Stretch(run, stamps, ("a",), (), positions)
    return HistoryPart(stretch, (), 1, last_run, 10 * SECOND, last * SECOND)


def state(at):
    return RobotState(round(SECOND * at), ("a",), np.zeros(1))


@pytest.fixture
def line():
    """Give a time line that ends at 50 s, and shows 49 s."""
    one = Timeline.until_now(ROBOT, 50 * SECOND)
    one.requested = 49 * SECOND
    one.take(part(48.5, 49), 49 * SECOND)
    return one


def test_an_answer_is_shown_with_the_state_before_it(line):
    assert (line.state.time, line.before.time, line.run) == (49.0, 48.5, 1)
    line.take(part(49.5), 49 * SECOND)
    assert (line.state.time, line.before) == (49.5, None)


def test_a_later_request_stays_when_an_earlier_one_is_answered(line):
    line.requested = 45 * SECOND
    line.take(part(48), 48 * SECOND)
    assert (line.state.time, line.requested) == (48.0, 45 * SECOND)
    line.take(part(44.99), 45 * SECOND)
    assert line.requested == round(44.99 * SECOND), "so that steps begin at the state"


def test_a_run_has_no_end_until_it_is_known():
    line = Timeline(ROBOT, 2)
    assert (line.end, line.left_at, line.requested, line.state) == (None,) * 4
    assert line.limited(7 * SECOND) == 7 * SECOND
    assert line.title(None) == ""
    line.take(part(30, run=2, last_run=3, last=30), None)
    assert line.end == line.left_at == 30 * SECOND
    assert line.limited(31 * SECOND) == 30 * SECOND
    assert not line.ends_live, "there is a later run"
    assert line.title(state(90)) == "run 2, 30.000 s"


@pytest.mark.parametrize(
    ("at", "length", "end", "back"),
    [
        (49, 30, 50, -1.0),
        (20, 30, 50, -30.0),
        (19.9, 30, 34.9, -15.0),  # in the middle
        (45, 4, 47, -2.0),
        (49, 0.5, 49.25, -0.25),
        (30, 60, 50, -20.0),
    ],
)
def test_a_time_line_moves_to_a_state_that_is_beyond_it(line, at, length, end, back):
    line.take(part(at), None)
    assert line.back(round(length * SECOND)) == back
    assert line.end == round(end * SECOND)
    assert line.ends_live == (end == 50)
    assert line.begin(round(60 * SECOND)) == 1, "zero would be the whole run"


def test_the_title_has_the_run_once_time_has_gone_back(line):
    assert line.title(state(60)) == "49.000 s"
    assert line.title(state(3)) == line.title(None) == "run 1, 49.000 s"
