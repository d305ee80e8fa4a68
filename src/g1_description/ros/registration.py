"""A node that outlives its master, and is known to the next one."""

from __future__ import annotations

import contextlib

import rosgraph
import rospy

from .own_node import FAILURES, own_node


def register_again() -> bool:
    """Tell the master what this node publishes and listens to, if it does not know.

    rospy does so once. A master that died and came back knows nothing of the nodes
    that ran on. Connections there are stay.

    Returns:
        Whether the node had to be registered.

    Raises:
        own_node.FAILURES: If there is no master.
        rosgraph.MasterException: If the master refuses.
    """
    name, uri = rospy.get_name(), rospy.get_node_uri()
    master = rosgraph.Master(name)
    with contextlib.suppress(rosgraph.MasterError):
        master.lookupNode(name)
        return False
    with own_node() as node:
        for topic, kind in node.getPublications(name)[2]:
            master.registerPublisher(topic, kind, uri)
        for topic, kind in node.getSubscriptions(name)[2]:
            publishers = master.registerSubscriber(topic, kind, uri)
            with contextlib.suppress(*FAILURES):
                node.publisherUpdate("/master", topic, publishers)
    return True
