"""Starting a node so that a signal always ends it, at once and quietly."""

from __future__ import annotations

import atexit
import os
import signal
import socket
import sys
import threading
from collections.abc import Callable
from contextlib import contextmanager

import rosgraph
import rospy

from g1_description.interrupts import ENDING_SIGNALS

SHUTDOWN_TIMEOUT = 1.8
"""Longest time from a signal to the end of the program, in [s]."""


def start_node(name: str, **options) -> None:
    """Start the node; a signal ends it from a thread of its own.

    rospy handles signals in the main thread. Where one meets that thread inside a
    call of rospy, such as publish(), rospy's handler waits for ever for a lock that
    the interrupted call holds. Here the system writes the signal's number into a
    socket, and a thread that reads it shuts the node down.

    What the node logs is in a file or a pipe at once: Python would keep it back there
    until there is more.

    Args:
        name: The node's name.
        options: More for ``rospy.init_node``.
    """
    for stream in sys.stdout, sys.stderr:  # Python 3.8 holds back errors, too
        stream.reconfigure(line_buffering=True)
    reader, writer = socket.socketpair()
    writer.setblocking(False)
    # In this order: a signal between the two would have no effect.
    signal.set_wakeup_fd(writer.fileno(), warn_on_full_buffer=False)
    handle_signals(lambda *_: None)
    codes: list[int] = []

    def end():
        for number in reader.recv(1):  # none if the program has ended by itself
            codes.append(128 + number)
            # rospy may wait for ever for a master that is not there.
            last = threading.Timer(SHUTDOWN_TIMEOUT, os._exit, codes)
            last.daemon = True
            last.start()
            rospy.signal_shutdown(f"signal {number}")

    thread = threading.Thread(target=end, daemon=True)
    thread.start()
    # Keeps both sockets, as a second signal is written, too; and lets the node be
    # unregistered before the program ends.
    sockets = reader, writer
    atexit.register(lambda: codes and sockets and thread.join(SHUTDOWN_TIMEOUT))
    try:
        rospy.init_node(name, disable_signals=True, **options)
    except rospy.ROSInitException as error:
        master = rosgraph.get_master_uri()
        message = f"{name}: rospy cannot start, is there a master at {master}? {error}"
        sys.exit(codes[0] if codes else message)
    rospy.core.add_preshutdown_hook(_tell_of_namesake)


def _tell_of_namesake(reason: str) -> None:
    """Log why the node ends where another one of its name has started."""
    if "same name" in reason:
        rospy.logwarn(
            "Another node called %s has started; the master ends this one.",
            rospy.get_name(),
        )


def handle_signals(handler: Callable) -> None:
    """Let a handler get the signals that end a node.

    ``nohup`` has its program ignore that the terminal is closed; that stays so.
    """
    for number in ENDING_SIGNALS:
        is_ignored = signal.getsignal(number) == signal.SIG_IGN
        if not (number == signal.SIGHUP and is_ignored):
            signal.signal(number, handler)


def at_shutdown(action: Callable[[], object]) -> None:
    """Call an action when the node is shut down, or now if it already is.

    Args:
        action: What to do; once or twice. ``rospy.on_shutdown`` alone forgets what
            comes while the shutdown has begun and is not over.
    """
    rospy.on_shutdown(action)
    if rospy.core.is_shutdown_requested():
        action()


@contextmanager
def quiet_when_closing():
    """Ignore what publishing raises while rospy closes the topics.

    rospy does so before ``is_shutdown`` turns true.
    """
    try:
        yield
    except rospy.ROSException:
        if not rospy.core.is_shutdown_requested():
            raise


def own_arguments() -> list[str]:
    """Return this program's arguments without ROS' remappings."""
    return rospy.myargv(sys.argv)[1:]
