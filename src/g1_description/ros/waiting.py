"""Waiting for a condition by wall time: simulated time may stand still."""

from __future__ import annotations

import math
import threading
import time
from typing import Callable, TypeVar

import rospy

from g1_description.errors import G1DescriptionError

POLL_PERIOD = 0.02
"""Time between two evaluations of a condition, in [s]."""

MASTER_PERIOD = 0.1
"""Time for a condition that calls the master or a service, in [s]."""

Result = TypeVar("Result")


class NoAnswerError(G1DescriptionError):
    """A robot, its clock, a simulator or the master does not answer in time."""


class RefusedError(G1DescriptionError):
    """A bridge or a simulator does not do what was requested."""


def wait_until(
    condition: Callable[[], Result],
    timeout: float | None = None,
    changed: threading.Condition | None = None,
    period: float = POLL_PERIOD,
) -> Result:
    """Wait until a condition holds.

    Args:
        condition: Returns a true value when it holds.
        timeout: Longest wait in [s]; None: no limit.
        changed: Locked while the condition is evaluated; a notification evaluates
            the condition at once.
        period: Longest time between two evaluations, in [s].

    Returns:
        The last result of the condition; false after the timeout.

    Raises:
        ROSInterruptException: If the node is shut down.
    """
    end = math.inf if timeout is None else time.monotonic() + timeout
    changed = changed or threading.Condition()
    with changed:
        while True:
            result = condition()
            if result or time.monotonic() >= end:
                return result
            if rospy.is_shutdown():
                raise rospy.ROSInterruptException("interrupted")
            changed.wait(period)


BUFFER = 1 << 20
"""Bytes read from a socket at once.

rospy drops old messages only within what one read returns; the rest stays in the
system's buffers, which hold several thousand joint states. With rospy's default, of
forty-five joint states, a slow reader falls behind by seconds.
"""
