"""A node's XML-RPC server that starts and ends at once.

rospy looks whether the master knows the node, and sleeps for a tenth of a second if
not: each node and command starts so much later, as registering takes a hundredth.

With rospy's server, a node ends half a second late and keeps a core busy until then.
rosgraph closes the server's socket while the server waits for calls, and goes on to
wait for the closed one, which fails at once, again and again. And rospy wakes its
registration thread before it sets the flag that lets the thread end, so the thread
waits for another half a second, and the shutdown waits for the thread.

rospy has no option for either. ``ROSHandler._is_registered``, which is private (rospy
1.15 to 1.17), and ``XmlRpcNode.shutdown`` are changed for the process that asks for it;
a rospy that has no such method starts as before.
"""

from __future__ import annotations

import threading
import time
from contextlib import suppress

from rosgraph.xmlrpc import XmlRpcNode
from rospy.core import is_shutdown
from rospy.impl.masterslave import ROSHandler

MAX_WAIT = 0.1
"""Longest wait in [s] for the registration; then rospy sleeps as long, and looks again.
"""

POLL = 0.005
"""Time in [s] from one look to the next."""

_is_registered = getattr(ROSHandler, "_is_registered", None)
_shutdown = XmlRpcNode.shutdown


def start_at_once() -> None:
    """Let the node of this process start as soon as the master knows it."""
    if _is_registered:
        ROSHandler._is_registered = _wait_for_registration


def _wait_for_registration(handler: ROSHandler) -> bool:
    """Wait until the master knows the node; return whether it does."""
    end = time.monotonic() + MAX_WAIT
    while not _is_registered(handler) and not is_shutdown() and time.monotonic() < end:
        time.sleep(POLL)
    return bool(_is_registered(handler))


def end_at_once() -> None:
    """Let the node of this process end at once when it is shut down."""
    XmlRpcNode.shutdown = _end


def _end(node: XmlRpcNode, reason: str) -> None:
    """End the server, and what waits for news of the master.

    Args:
        node: What serves the node's slave API.
        reason: For the log.
    """
    server, registrations = node.server, getattr(node.handler, "reg_man", None)
    _shutdown(node, reason)  # first: else the server might begin again
    if server:
        # It waits for the server's end. Python 3.12 starts no thread while it exits.
        with suppress(RuntimeError):
            threading.Thread(target=server.shutdown, daemon=True).start()
    if registrations:
        with registrations.cond:
            registrations.cond.notify_all()
