"""Keeps a node registered with its master and connected to its publishers."""

from __future__ import annotations

import contextlib
import threading
from collections import Counter
from typing import Callable

import rosgraph
import rospy
from rospy.impl.registration import get_service_manager

from .slave_api import SLAVE_API_ERRORS, slave_api

PERIOD = 1.0
"""Time between two calls of the master in [s] of wall time; each costs some
milliseconds of processor time."""


def stay_registered(
    period: float = PERIOD, look: Callable[[list], None] = lambda state: None
) -> None:
    """Call ``restore_connections`` again and again, until the node is shut down.

    A thread of its own does it: the master may take long to answer, or be gone.

    Args:
        period: Time between two calls of the master in [s] of wall time.
        look: Gets what the master's ``getSystemState`` returns each time.
    """
    stopped = threading.Event()

    def run():
        while not stopped.wait(period):
            # Without a master, or with one that is starting, the next time will do.
            with contextlib.suppress(*SLAVE_API_ERRORS, rosgraph.MasterException):
                state = rosgraph.Master(rospy.get_name()).getSystemState()
                if rospy.core.is_shutdown_requested():
                    return
                if restore_connections(state):
                    rospy.loginfo("The master did not know this node; it does now.")
                look(state)

    rospy.on_shutdown(stopped.set)
    threading.Thread(target=run, daemon=True).start()


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
                addresses = _addresses(master, publishers[topic])
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


def _addresses(master: rosgraph.Master, nodes: list[str]) -> list[str]:
    """Ask the master where nodes are; one that has just gone is left out."""
    addresses = []
    for node in nodes:
        with contextlib.suppress(rosgraph.MasterError):
            addresses.append(master.lookupNode(node))
    return addresses
