"""Keeps a node registered with its master and connected to its publishers."""

from __future__ import annotations

import contextlib
import socket
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from urllib.parse import urlparse

import rosgraph
import rospy
from rospy.impl.registration import get_service_manager

from g1_description.ros.transport.broken_connections import BrokenConnections
from g1_description.ros.transport.broken_networks import answers_within

from .lifecycle import at_shutdown
from .slave_api import SLAVE_API_ERRORS, slave_api

PERIOD = 2.0
"""Time between two calls of the master in [s] of wall time; each costs some
milliseconds of processor time."""

LOOK_PERIOD = 0.1
"""Time between two looks for broken connections in [s] of wall time."""

ANSWER_TIMEOUT = 2.0
"""Longest time in [s] that the master may take for an answer. After a break its answer
to an old question may come late, and a new one is answered at once."""

REACH_TIMEOUT = 0.5
"""Longest time in [s] in which a node must be reached."""


def stay_connected(
    on_publishers: Callable[[Mapping[str, list[str]]], None] = lambda _: None,
    period: float = PERIOD,
) -> None:
    """Keep this node registered and connected, from a thread, until it is shut down.

    Args:
        on_publishers: Called with the nodes that publish each topic, again and again.
        period: Time between two calls of the master in [s] of wall time.
    """
    stopped, broken = threading.Event(), BrokenConnections()

    def run():
        due = time.monotonic() + period
        while not stopped.wait(LOOK_PERIOD):
            is_due = time.monotonic() >= due
            if broken.close():
                due = 0.0  # as soon as they have ended
            elif is_due:
                _ask_master(on_publishers)
                due = time.monotonic() + period

    at_shutdown(stopped.set)
    threading.Thread(target=run, daemon=True).start()


def _ask_master(
    on_publishers: Callable[[Mapping[str, list[str]]], None],
) -> None:
    """Restore what the master does not know, and hand on what it knows."""
    # Without a master, or with one that is starting, the next time will do.
    ignored = contextlib.suppress(*SLAVE_API_ERRORS, rosgraph.MasterException)
    with ignored, answers_within(ANSWER_TIMEOUT):
        state = rosgraph.Master(rospy.get_name()).getSystemState()
        if rospy.core.is_shutdown_requested():
            return
        if restore_connections(state):
            rospy.loginfo("The master did not know this node; it does now.")
        on_publishers(dict(state[0]))


def restore_connections(state: list) -> bool:
    """Register what the master does not know, reconnect to lost publishers.

    rospy registers once: a master that died and came back knows nothing of the nodes
    that ran on. And it connects once: a connection that breaks while its publisher
    lives stays broken.

    Args:
        state: What the master's ``getSystemState`` returns.

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
        connections = Counter(
            row[4] for row in node.getBusInfo(name)[2] if row[2] == "i"
        )
        for topic, kind in node.getSubscriptions(name)[2]:
            if name not in subscribers.get(topic, ()):
                addresses = master.registerSubscriber(topic, kind, uri)
                registered = True
            elif len(publishers.get(topic, ())) > connections[topic]:
                addresses = [*reachable(master, publishers[topic]).values()]
            else:
                continue
            # rospy connects to those it is not connected to.
            node.publisherUpdate("/master", topic, addresses)
    return _register_services(master, dict(state[2])) or registered


def _register_services(master: rosgraph.Master, known: dict[str, list[str]]) -> bool:
    """Register the services of this node that nobody is known to offer.

    Among them are those of rospy itself, such as ``~get_loggers``.

    Args:
        master: Where to.
        known: Nodes by service.

    Returns:
        Whether there were any.
    """
    # The slave API does not tell of services.
    services = get_service_manager().get_services()
    missing = [(name, uri) for name, uri in services if not known.get(name)]
    for name, uri in missing:
        master.registerService(name, uri, rospy.get_node_uri())
    return bool(missing)


def reachable(master: rosgraph.Master, nodes: Iterable[str]) -> dict[str, str]:
    """Ask the master where nodes are; those that are gone are left out.

    rospy asks a node that does not answer for ever, in a thread for each time that it
    is told of it. The master does not notice that a host died, and names its nodes.

    Args:
        master: Whom to ask.
        nodes: Their names.

    Returns:
        Addresses of their slave APIs by name.
    """
    addresses = {}
    for node in nodes:
        with contextlib.suppress(rosgraph.MasterError, OSError):
            address = master.lookupNode(node)
            parts = urlparse(address)
            place = parts.hostname, parts.port
            socket.create_connection(place, REACH_TIMEOUT).close()
            addresses[node] = address
    return addresses
