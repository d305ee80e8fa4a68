"""An XML-RPC server that ends at once.

With rospy's, a node ends half a second late and keeps a core busy until then. rosgraph
closes the server's socket while the server waits for calls, and goes on to wait for the
closed one, which fails at once, again and again. And rospy wakes its registration
thread before it sets the flag that lets the thread end, so the thread waits for another
half a second, and the shutdown waits for the thread.

rospy has no option for this. ``XmlRpcNode.shutdown`` is changed for the process that
calls ``end_at_once``.
"""

from __future__ import annotations

import threading
from contextlib import suppress

from rosgraph.xmlrpc import XmlRpcNode

_shutdown = XmlRpcNode.shutdown


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
