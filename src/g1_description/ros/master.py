"""Calls of the master, and the errors of calls."""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Callable, Mapping
from http.client import HTTPException
from xml.parsers.expat import ExpatError
from xmlrpc.client import Error

import rosgraph
import rospy

from g1_description.ros.lifecycle import at_shutdown

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
