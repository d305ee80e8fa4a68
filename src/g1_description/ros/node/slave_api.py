"""Client of this node's own slave API."""

from __future__ import annotations

from http.client import HTTPException
from urllib.parse import urlparse
from xml.parsers.expat import ExpatError
from xmlrpc.client import Error, ServerProxy

import rosgraph.network
import rospy

SLAVE_API_ERRORS = (OSError, Error, ExpatError, HTTPException)
"""Exceptions that a call to a slave API may raise."""


def slave_api() -> ServerProxy:
    """Make a client of this node's slave API.

    It uses the loopback: a node behind a router may not reach its own address.
    """
    host = "[::1]" if rosgraph.network.use_ipv6() else "127.0.0.1"
    return ServerProxy(f"http://{host}:{urlparse(rospy.get_node_uri()).port}/")
