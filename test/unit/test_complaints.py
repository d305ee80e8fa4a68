"""What is logged of faults that come again and again."""

import time

import pytest

from g1_description.ros.node import complaints
from g1_description.ros.node.complaints import Complaints

PERIOD = 0.1
DEADLINE = 10.0


class Log:
    """Takes the lines."""

    def __init__(self):
        self.lines = []

    def __call__(self, form, line):
        self.lines.append(form % line)


@pytest.fixture
def log(monkeypatch):
    monkeypatch.setattr(complaints, "OVER", 1.0)
    return Log()


def tell_until(condition, told, log, sentence, **options):
    """Tell the same again and again until a condition holds."""
    end = time.monotonic() + DEADLINE
    while not condition():
        assert time.monotonic() < end, log.lines
        told.tell("kind", sentence, PERIOD, log, **options)
        time.sleep(0.01)


def test_events_are_counted_and_told_again(log):
    told = Complaints()
    tell_until(lambda: len(log.lines) == 3, told, log, "a thing")
    assert log.lines[0] == "a thing"
    assert log.lines[1].startswith("a thing (")
    assert log.lines[1].endswith(" more like it)")


def test_a_state_that_lasts_is_told_once_until_it_changes_or_was_over(log):
    told = Complaints()
    end = time.monotonic() + 6 * PERIOD
    tell_until(
        lambda: log.lines and time.monotonic() > end, told, log, "this", stands=True
    )
    assert log.lines == ["this"]
    tell_until(lambda: len(log.lines) == 2, told, log, "that", stands=True)
    assert log.lines[1] == "that"
    over = time.monotonic() + 1.2
    while time.monotonic() < over:
        time.sleep(0.05)
    tell_until(lambda: len(log.lines) == 3, told, log, "that", stands=True)
    assert log.lines[2] == "that"


def test_a_state_that_was_left_before_its_turn_is_not_told(log):
    told = Complaints()
    tell_until(lambda: log.lines, told, log, "this", stands=True)
    told.tell("kind", "that", PERIOD, log, stands=True)
    end = time.monotonic() + 6 * PERIOD
    tell_until(lambda: time.monotonic() > end, told, log, "this", stands=True)
    assert log.lines == ["this"]
