"""Lines on faults that come again and again."""

import time

import pytest
from waiting import wait_for

from g1_description.ros import log as throttled_log
from g1_description.ros.log import ThrottledLog

PERIOD = 1.0


class Log:
    """Takes the lines."""

    def __init__(self):
        self.lines = []

    def __call__(self, form, line):
        self.lines.append(form % line)


@pytest.fixture
def log(monkeypatch):
    # Longer than a busy machine leaves between two of the messages that lie together.
    monkeypatch.setattr(throttled_log, "EXPIRY", 60.0)
    return Log()


def tell_until(condition, throttled, log, message, **options):
    """Log the same again and again until a condition holds."""

    def holds():
        return condition() or throttled.warn("kind", message, PERIOD, log, **options)

    wait_for(holds, f"another line than {log.lines}")


def test_events_are_counted_and_logged_again(log):
    throttled = ThrottledLog()
    throttled.warn("kind", "a thing", PERIOD, log)
    wait_for(lambda: log.lines, "the first line")
    assert log.lines[0] == "a thing"
    tell_until(lambda: len(log.lines) == 3, throttled, log, "a thing")
    assert log.lines[1].startswith("a thing (")
    assert log.lines[1].endswith(" more like it)")


def test_a_state_that_lasts_is_logged_once_until_it_changes_or_was_over(
    log, monkeypatch
):
    throttled = ThrottledLog()
    end = time.monotonic() + 2 * PERIOD
    tell_until(
        lambda: log.lines and time.monotonic() > end,
        throttled,
        log,
        "this",
        lasts=True,
    )
    assert log.lines == ["this"]
    tell_until(lambda: len(log.lines) == 2, throttled, log, "that", lasts=True)
    assert log.lines[1] == "that"
    monkeypatch.setattr(throttled_log, "EXPIRY", 0.1)
    over = time.monotonic() + 0.2
    wait_for(lambda: time.monotonic() > over, "the end of the fault")
    throttled.warn("kind", "that", PERIOD, log, lasts=True)
    monkeypatch.setattr(throttled_log, "EXPIRY", 60.0)
    tell_until(lambda: len(log.lines) == 3, throttled, log, "that", lasts=True)
    assert log.lines[2] == "that"


def test_a_state_that_was_left_before_its_turn_is_not_logged(log):
    throttled = ThrottledLog()
    tell_until(lambda: log.lines, throttled, log, "this", lasts=True)
    throttled.warn("kind", "that", PERIOD, log, lasts=True)
    end = time.monotonic() + 2 * PERIOD
    tell_until(lambda: time.monotonic() > end, throttled, log, "this", lasts=True)
    assert log.lines == ["this"]
