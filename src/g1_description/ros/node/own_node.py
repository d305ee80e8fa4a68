"""This node as others see it: its slave API, by which ROS' tools ask a node."""

from __future__ import annotations

from http.client import HTTPException
from urllib.parse import urlparse
from xmlrpc.client import Error, ServerProxy

import rosgraph.network
import rospy

FAILURES = (OSError, Error, HTTPException)
"""What a call to it may raise."""


def own_node() -> ServerProxy:
    """Give the slave API of this node.

    By the loopback: a node behind a router need not reach its own address.
    """
    host = "[::1]" if rosgraph.network.use_ipv6() else "127.0.0.1"
    return ServerProxy(f"http://{host}:{urlparse(rospy.get_node_uri()).port}/")
