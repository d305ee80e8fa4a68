"""Start of a node that any signal shuts down."""

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


unbroken = threading.Lock()
"""Held by what is done at a shutdown and takes longer, such as writing a file."""


def start_node(name: str, **options) -> None:
    """Start the node; a signal ends it from a thread of its own.

    rospy handles signals in the main thread. If the signal interrupts a call such as
    publish(), its handler deadlocks on a lock of that call. Here the system writes the
    signal's number into a socket, and a thread that reads it shuts the node down.

    Output to a file or pipe is line-buffered.

    Args:
        name: The node's name.
        options: Further arguments of ``rospy.init_node``.
    """
    for stream in sys.stdout, sys.stderr:  # Python 3.8 holds back errors, too
        stream.reconfigure(line_buffering=True)
    reader, writer = socket.socketpair()
    writer.setblocking(False)
    # In this order: a signal between the two would have no effect.
    signal.set_wakeup_fd(writer.fileno(), warn_on_full_buffer=False)
    handle_signals(lambda *_: None)
    codes: list[int] = []

    def cut(code):
        with unbroken:
            os._exit(code)

    def end():
        for number in reader.recv(1):  # none if the program has ended by itself
            codes.append(128 + number)
            # rospy may block on a missing master.
            last = threading.Timer(SHUTDOWN_TIMEOUT, cut, codes)
            last.daemon = True
            last.start()
            rospy.signal_shutdown(f"signal {number}")

    thread = threading.Thread(target=end, daemon=True)
    thread.start()
    # Keeps both sockets open for a second signal, and waits for unregistration.
    sockets = reader, writer
    atexit.register(lambda: codes and sockets and thread.join(SHUTDOWN_TIMEOUT))
    try:
        rospy.init_node(name, disable_signals=True, **options)
    except rospy.ROSInitException:
        sys.exit(codes[0] if codes else f"{name}: {no_master()}")
    rospy.core.add_preshutdown_hook(_log_namesake)


def no_master() -> str:
    """Say that there is no master, and what to do."""
    return (
        f"No ROS master at {rosgraph.get_master_uri()}; start a robot with 'roslaunch "
        "g1_description display.launch', or look for the cause with 'rosrun "
        "g1_description doctor'."
    )


def _log_namesake(reason: str) -> None:
    """Log that another node of the same name replaces this one."""
    if "same name" in reason:
        rospy.logwarn(
            "Shut down by the master: another node named %s has started.",
            rospy.get_name(),
        )


def handle_signals(handler: Callable) -> None:
    """Install a handler of the signals that end a node.

    SIGHUP stays ignored if it was, as with ``nohup``.
    """
    for number in ENDING_SIGNALS:
        is_ignored = signal.getsignal(number) == signal.SIG_IGN
        if not (number == signal.SIGHUP and is_ignored):
            signal.signal(number, handler)


def at_shutdown(action: Callable[[], object]) -> None:
    """Call an action when the node is shut down, or now if it already is.

    It may be called twice: ``rospy.on_shutdown`` alone loses actions that are added
    during the shutdown.
    """
    rospy.on_shutdown(action)
    if rospy.core.is_shutdown_requested():
        action()


@contextmanager
def quiet_when_closing():
    """Ignore errors of publishing while rospy closes the topics.

    rospy closes them before ``is_shutdown`` turns true.
    """
    try:
        yield
    except rospy.ROSException:
        if not rospy.core.is_shutdown_requested():
            raise
