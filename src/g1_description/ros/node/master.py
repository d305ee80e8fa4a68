"""Keeps a node registered with its master."""

from __future__ import annotations

import contextlib
import threading
from collections.abc import Callable, Mapping

import rosgraph
import rospy
from rospy.impl.registration import get_service_manager

from .lifecycle import at_shutdown
from .slave_api import SLAVE_API_ERRORS, slave_api

PERIOD = 2.0
"""Time between two calls of the master in [s] of wall time; each costs some
milliseconds of processor time."""


def stay_registered(
    on_publishers: Callable[[Mapping[str, list[str]]], None] = lambda _: None,
    period: float = PERIOD,
) -> None:
    """Keep this node registered, from a thread, until it is shut down.

    Args:
        on_publishers: Called with the nodes that publish each topic, again and again.
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
    """Restore what the master does not know, and hand on what it knows."""
    # Without a master, or with one that is starting, the next time will do.
    with contextlib.suppress(*SLAVE_API_ERRORS, rosgraph.MasterException):
        state = rosgraph.Master(rospy.get_name()).getSystemState()
        if rospy.core.is_shutdown_requested():
            return
        if restore_registrations(state):
            rospy.loginfo("The master did not know this node; it does now.")
        on_publishers(dict(state[0]))


def restore_registrations(state: list) -> bool:
    """Register the topics and services of this node that the master does not know.

    rospy registers once: a master that died and came back knows nothing of the nodes
    that ran on.

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
        for topic, kind in node.getSubscriptions(name)[2]:
            if name not in subscribers.get(topic, ()):
                addresses = master.registerSubscriber(topic, kind, uri)
                registered = True
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
