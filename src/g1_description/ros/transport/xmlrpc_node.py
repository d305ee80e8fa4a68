"""An XML-RPC server that ends at once.

With rospy's, a node ends half a second late and keeps a core busy until then. rosgraph
closes the server's socket while the server waits for calls, and goes on to wait for the
closed one, which fails at once, again and again. And rospy wakes its thread for
registrations before that may end; it then waits for another half a second, and the
shutdown for the thread.

rospy has no option for this. ``XmlRpcNode.shutdown`` is changed for the process that
calls ``end_at_once``.
"""

from __future__ import annotations

import threading

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
    if server:
        # This waits until the server has ended, which is half a second at most.
        threading.Thread(target=server.shutdown, daemon=True).start()
    _shutdown(node, reason)
    if registrations:
        with registrations.cond:
            registrations.cond.notify_all()
