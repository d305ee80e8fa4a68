"""Keeps a node registered with its master and connected to its publishers."""

from __future__ import annotations

import contextlib
from collections import Counter

import rosgraph
import rospy

from .slave_api import slave_api


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
    return registered


def _addresses(master: rosgraph.Master, nodes: list[str]) -> list[str]:
    """Ask the master where nodes are; one that has just gone is left out."""
    addresses = []
    for node in nodes:
        with contextlib.suppress(rosgraph.MasterError):
            addresses.append(master.lookupNode(node))
    return addresses
