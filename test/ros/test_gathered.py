"""Messages gather while nobody needs them, and none falls behind."""

from __future__ import annotations

import threading
import time

import pytest
from waiting import DEADLINE

pytest.importorskip("rospy", reason="rospy is not installed")

from g1_description.ros.robot_states import gathered

PERIOD = 0.05
COUNT = 400
FEW = COUNT // 2
"""Pauses that a busy machine may take as long as: far fewer than messages."""


def fed(messages, *callbacks):
    """Hand messages to callbacks as a connection's thread does; give the time it took.

    Args:
        messages: Pairs of a time since the beginning, in [s], and a message; rospy
            reads one as soon as it is there and the one before was taken.
        callbacks: All that subscribe to the topic.
    """
    took = []

    def feed():
        pause, began = threading.Event(), time.monotonic()
        for due, message in messages:
            pause.wait(max(0.0, began + due - time.monotonic()))
            for callback in callbacks:
                callback(message)
        took.append(time.monotonic() - began)

    thread = threading.Thread(target=feed)  # which no message has come to yet
    thread.start()
    thread.join(DEADLINE)
    return took[0]


def test_a_burst_is_taken_at_once():
    n_callbacks = 2
    seen = [[] for _ in range(n_callbacks)]
    burst = [(0.0, number) for number in range(COUNT)]
    took = fed(burst, *(gathered(some.append, PERIOD) for some in seen))
    assert seen == [[*range(COUNT)]] * n_callbacks
    assert took < FEW * PERIOD, "not a pause for each"


def test_a_stream_does_not_fall_behind():
    # 1000 Hz, as joint states come: more in a second than there are pauses.
    n_callbacks = 2
    stream = [(0.001 * number, number) for number in range(COUNT)]
    seen = [[] for _ in range(n_callbacks)]
    took = fed(stream, *(gathered(some.append, PERIOD) for some in seen))
    assert seen == [[*range(COUNT)]] * n_callbacks
    assert took < FEW * PERIOD


def test_a_message_that_was_waited_for_lets_others_gather():
    done = gathered(lambda _: None, PERIOD)
    assert fed([(0.0, 0), (3 * PERIOD, 1)], done) >= 4 * PERIOD


def test_what_was_gathered_is_read_without_a_pause():
    calls = []
    period = 20 * PERIOD  # which a busy machine does not take between two calls
    done = gathered(lambda _: calls.append(time.monotonic()), period)
    fed([(0.0, 0), (0.5 * period, 1), (0.6 * period, 2)], done)
    assert calls[1] - calls[0] >= period
    assert calls[2] - calls[1] < period
