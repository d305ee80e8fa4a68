"""Keeps a node registered with its master."""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Callable, Mapping
from http.client import HTTPConnection, HTTPException
from typing import Any
from urllib.parse import urlparse
from xml.parsers.expat import ExpatError
from xmlrpc.client import Error, ServerProxy, Transport

import rosgraph
import rosgraph.network
import rospy
from rospy.impl.registration import get_service_manager

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


def slave_api() -> ServerProxy:
    """Make a client of this node's slave API.

    It uses the loopback: a node behind a router may not reach its own address.
    """
    host = "[::1]" if rosgraph.network.use_ipv6() else "127.0.0.1"
    return ServerProxy(f"http://{host}:{urlparse(rospy.get_node_uri()).port}/")


class _TimedTransport(Transport):
    """HTTP with a timeout."""

    def __init__(self, timeout: float) -> None:
        super().__init__()
        self._timeout = timeout

    def make_connection(self, host: Any) -> HTTPConnection:
        connection = super().make_connection(host)
        connection.timeout = self._timeout
        return connection


def slave_api_of(address: str, timeout: float) -> ServerProxy:
    """Make a client of another node's slave API, which may hang.

    Args:
        address: The node's URI, as the master knows it.
        timeout: Longest time in [s] to connect, and for each answer; after it a call
            raises an OSError.
    """
    return ServerProxy(address, transport=_TimedTransport(timeout))


PERIOD = 2.0
"""Time between two calls of the master in [s] of wall time; each takes some ms."""


def stay_registered(
    on_publishers: Callable[[Mapping[str, list[str]]], None] = lambda _: None,
    period: float = PERIOD,
) -> None:
    """Keep this node registered, from a thread, until it is shut down.

    Args:
        on_publishers: Called with the publishers of each topic, once per period.
        period: Time between two calls of the master in [s] of wall time.
    """
    stopped = threading.Event()

    def run():
        while not stopped.wait(period):
            _ask_master(on_publishers)

    at_shutdown(stopped.set)
    threading.Thread(target=run, daemon=True).start()


def _ask_master(
    on_publishers: Callable[[Mapping[str, list[str]]], None],
) -> None:
    """Restore missing registrations, and report the publishers."""
    # If the master is down or starting, the next call will do.
    with contextlib.suppress(*SLAVE_API_ERRORS, rosgraph.MasterException):
        state = rosgraph.Master(rospy.get_name()).getSystemState()
        if rospy.core.is_shutdown_requested():
            return
        if restore_registrations(state):
            rospy.loginfo("The master had lost this node; registered again.")
        on_publishers(dict(state[0]))


def restore_registrations(state: list) -> bool:
    """Register the topics and services of this node that the master has lost.

    rospy registers once; a restarted master does not know running nodes.

    Args:
        state: Result of the master's ``getSystemState``.

    Returns:
        Whether anything had to be registered.

    Raises:
        slave_api.SLAVE_API_ERRORS: If there is no master.
        rosgraph.MasterException: If the master refuses.
    """
    name, uri = rospy.get_name(), rospy.get_node_uri()
    publishers, subscribers = dict(state[0]), dict(state[1])
    master = rosgraph.Master(name)
    registered = False
    with slave_api() as node:
        for topic, kind in node.getPublications(name)[2]:
            if name not in publishers.get(topic, ()):
                master.registerPublisher(topic, kind, uri)
                registered = True
        for topic, kind in node.getSubscriptions(name)[2]:
            if name not in subscribers.get(topic, ()):
                addresses = master.registerSubscriber(topic, kind, uri)
                registered = True
                node.publisherUpdate("/master", topic, addresses)
    return _register_services(master, dict(state[2])) or registered


def _register_services(master: rosgraph.Master, known: dict[str, list[str]]) -> bool:
    """Register the services of this node, rospy's own too, that have no provider."""
    # The slave API does not list services.
    services = get_service_manager().get_services()
    missing = [(name, uri) for name, uri in services if not known.get(name)]
    for name, uri in missing:
        master.registerService(name, uri, rospy.get_node_uri())
    return bool(missing)
