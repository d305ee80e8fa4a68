"""Clients of the slave APIs of this node and of others."""

from __future__ import annotations

from http.client import HTTPConnection, HTTPException
from typing import Any
from urllib.parse import urlparse
from xml.parsers.expat import ExpatError
from xmlrpc.client import Error, ServerProxy, Transport

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


class _TimedTransport(Transport):
    """HTTP with a deadline; Python's own waits for ever."""

    def __init__(self, timeout: float) -> None:
        super().__init__()
        self._timeout = timeout

    def make_connection(self, host: Any) -> HTTPConnection:
        """Connect, and answer, within the deadline."""
        connection = super().make_connection(host)
        connection.timeout = self._timeout
        return connection


def slave_api_of(address: str, timeout: float) -> ServerProxy:
    """Make a client of another node's slave API, which may hang.

    Args:
        address: The node's URI, as the master knows it.
        timeout: Longest time in [s] to connect, and for each answer; whoever calls gets
            an OSError after it.
    """
    return ServerProxy(address, transport=_TimedTransport(timeout))
