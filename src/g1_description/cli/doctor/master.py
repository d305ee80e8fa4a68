"""The master and the nodes that it knows, asked with the standard library alone."""

from __future__ import annotations

import socket
from collections.abc import Iterable
from concurrent.futures import ThreadPoolExecutor
from http.client import HTTPException
from typing import Any
from xml.parsers.expat import ExpatError
from xmlrpc.client import Error, ServerProxy, Transport

from g1_description.cli.doctor.machine import (
    addresses_of,
    is_own,
    is_stopped,
    listening_process,
    within,
)
from g1_description.cli.doctor.nodes import SILENT, UNKNOWN_HOST, Graph, NodeAnswer
from g1_description.cli.doctor.shell import host_of, is_loopback

TIMEOUT = 4.0
"""Longest wait for an answer of the master or a node, in [s]: machines may be busy.
Who refuses to connect is not waited for."""

CALLER = "/g1_description_doctor"

ERRORS = (OSError, Error, HTTPException, ExpatError, ValueError, TypeError, LookupError)
"""What asking may raise; whoever answers need not speak ROS."""


class _Transport(Transport):
    """One that does not wait for ever."""

    def make_connection(self, host: Any) -> Any:
        """Connect with a deadline."""
        connection = super().make_connection(host)
        connection.timeout = TIMEOUT
        return connection


def ask(uri: str, method: str, *given: Any) -> Any:
    """Call a method of the master or a node.

    Args:
        uri: Where it is.
        method: Its name in the XML-RPC interface of ROS.
        given: Arguments behind the caller's name.

    Returns:
        The value that is answered.

    Raises:
        ERRORS: If there is no answer, or none of ROS.
        LookupError: If the answer is that it failed.
    """
    proxy = ServerProxy(uri, transport=_Transport())
    code, text, value = within(
        1.5 * TIMEOUT, lambda: getattr(proxy, method)(CALLER, *given)
    )
    if code != 1:
        raise LookupError(str(text))
    return value


def reason_of(error: BaseException) -> str:
    """Say in few words why nobody answered."""
    if isinstance(error, socket.gaierror):
        return UNKNOWN_HOST
    if isinstance(error, ConnectionRefusedError):
        return "nothing listens there"
    # Before Python 3.10, socket.timeout is another.
    if isinstance(error, (TimeoutError, socket.timeout)):
        return f"{SILENT} within {TIMEOUT:g} s"
    if isinstance(error, OSError):
        return (error.strerror or str(error)).lower()
    return "what answers there is not of ROS"


class Master:
    """The master of ROS_MASTER_URI."""

    def __init__(self, uri: str) -> None:
        """Ask nothing yet.

        Args:
            uri: Where it is.
        """
        self.uri = uri

    def ping(self) -> None:
        """Ask for its process.

        Raises:
            ERRORS: If there is no master.
        """
        ask(self.uri, "getPid")

    def graph(self) -> Graph:
        """Ask for the state of the graph."""
        tables = [dict(table) for table in ask(self.uri, "getSystemState")]
        return Graph(*tables)

    def parameter(self, name: str, default: Any = None) -> Any:
        """Ask for a parameter."""
        try:
            return ask(self.uri, "getParam", name)
        except LookupError:
            return default

    def find_parameter(self, name: str, namespace: str) -> str:
        """Search for a parameter in a namespace and above; empty if there is none."""
        if name.startswith("/"):
            return name if self.parameter(name) is not None else ""
        places = namespace.strip("/").split("/") if namespace.strip("/") else []
        for depth in range(len(places), -1, -1):
            full = "/" + "/".join([*places[:depth], name])
            if self.parameter(full) is not None:
                return full
        return ""

    def ask_nodes(self, nodes: Iterable[str]) -> dict[str, NodeAnswer]:
        """Ask nodes what they publish, all at the same time.

        Returns:
            What they answer, without those that have just gone.
        """
        names = list(nodes)
        with ThreadPoolExecutor(max(1, min(32, len(names)))) as pool:
            answers = list(pool.map(self._ask_node, names))
        return {name: answer for name, answer in zip(names, answers) if answer}

    def process_of(self, node: str) -> str:
        """Find the process of a node on this machine; empty if it is not seen."""
        try:
            host, port = host_of(self._lookup(node))
        except ERRORS:
            return ""
        is_here = any(map(is_own, addresses_of(host)))
        return listening_process(port) if is_here else ""

    def _lookup(self, node: str) -> str:
        """Ask for the address of a node; once more if the master is late."""
        try:
            return str(ask(self.uri, "lookupNode", node))
        except LookupError:
            raise
        except ERRORS:
            return str(ask(self.uri, "lookupNode", node))

    def _ask_node(self, node: str) -> NodeAnswer | None:
        """Ask one node; None if the master does not know it any more."""
        try:
            uri = self._lookup(node)
        except LookupError:
            return None
        try:
            host, port = host_of(uri)
        except ValueError:
            return NodeAnswer(uri, UNKNOWN_HOST)
        addresses = addresses_of(host)
        if not addresses:
            return NodeAnswer(uri, UNKNOWN_HOST)
        is_here = any(map(is_own, addresses))
        stays = all(map(is_loopback, addresses))
        try:
            topics = frozenset(str(row[0]) for row in ask(uri, "getPublications"))
        except ERRORS as error:
            problem = reason_of(error)
            is_silent = is_here and problem.startswith(SILENT)
            process = listening_process(port) if is_silent else ""
            stopped = process if process and is_stopped(process) else ""
            return NodeAnswer(uri, problem, frozenset(), is_here, stays, stopped)
        return NodeAnswer(uri, "", topics, is_here, stays)
