"""Calls of the master and of services, their errors, and waits by wall time."""

from __future__ import annotations

import contextlib
import math
import threading
import time
from collections.abc import Mapping
from http.client import HTTPException
from typing import Callable, TypeVar
from xml.parsers.expat import ExpatError
from xmlrpc.client import Error

import rosgraph
import rospy

from g1_description.errors import G1DescriptionError
from g1_description.ros.lifecycle import at_shutdown

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
    """Wait until a condition holds, by wall time: simulated time may stand still.

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


SLAVE_API_ERRORS = (OSError, Error, ExpatError, HTTPException)
"""Exceptions that a call to a slave API may raise."""

# A broken connection raises exceptions that are not rospy's.
SERVICE_ERRORS = (
    rospy.ServiceException,
    rospy.ROSException,
    rospy.exceptions.ROSInternalException,
    rosgraph.MasterException,
    *SLAVE_API_ERRORS,
)
"""Exceptions that a call of a service may raise."""


def watch_publishers(
    on_publishers: Callable[[Mapping[str, list[str]]], None], period: float
) -> None:
    """Ask the master for the publishers of each topic, in a thread, until shutdown.

    Args:
        on_publishers: Called with the names of nodes by topic.
        period: Time between two calls of the master in [s] of wall time; each takes
            some ms.
    """
    stopped = threading.Event()

    def run():
        while not stopped.wait(period):
            # If the master is down or starting, the next call will do.
            with contextlib.suppress(*SLAVE_API_ERRORS, rosgraph.MasterException):
                state = rosgraph.Master(rospy.get_name()).getSystemState()
                if not rospy.core.is_shutdown_requested():
                    on_publishers(dict(state[0]))

    at_shutdown(stopped.set)
    threading.Thread(target=run, daemon=True).start()


BUFFER = 1 << 20
"""Bytes read from a socket at once.

rospy drops old messages only within what one read returns; the rest stays in the
system's buffers, which hold several thousand joint states. With rospy's default, of
forty-five joint states, a slow reader falls behind by seconds.
"""
