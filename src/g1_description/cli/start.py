"""Start and end of a command, which a signal may interrupt at any time.

Slow imports happen here, when signals are already handled.
"""

from __future__ import annotations

import _thread
import importlib
import os
import signal
import sys
import threading
import time
from collections.abc import Callable
from functools import partial
from typing import Any, NoReturn

from g1_description.command_line import exit_with_error

INTERRUPTED = 130
"""Exit code after Ctrl-C, as in shells."""

PIPE_CLOSED = 141
"""Exit code after SIGPIPE, as in shells."""

IMPORTED = time.time_ns()
"""Wall time at which this module was imported, in [ns]."""

MAX_START = 10_000_000_000
"""Longest time that rosrun and Python need until then on a busy machine, in [ns]."""

WITH_OPTIONS = ("check", "play", "pose")
"""Commands with a module ``NAME_options``, which parses the command line first: help
and mistakes need no slow import."""

AGAIN = 0.05
"""Time in [s] after which an ignored interrupt is sent again."""


def run(module: str, farewell: str = "interrupted.") -> None:
    """Import and run a command; exit quietly after a signal.

    Args:
        module: Its module in this folder, named as the command; ``main`` does the work
            and may raise KeyboardInterrupt.
        farewell: Message after an interrupt.
    """
    name = module.rpartition(".")[2]
    try:
        _run(module, f"{name}: {farewell}")
    except ModuleNotFoundError as error:
        exit_with_error(name, error)


def _run(module: str, farewell: str) -> None:
    """Do the same where all libraries are there."""
    sys.unraisablehook = _come_again
    # Some libraries misinterpret an interrupt during their import.
    _answer_interrupt(_end_at_once)
    given = []
    if module in WITH_OPTIONS:
        options = importlib.import_module(f".{module}_options", __package__)
        given = [options.parsed()]
    main = importlib.import_module(f".{module}", __package__).main
    _answer_interrupt(signal.default_int_handler)
    try:
        try:
            main(*given)
        finally:
            # Python has work to do after main that must not print a traceback.
            if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
                _answer_interrupt(_end_at_once)
    except BrokenPipeError:  # as before `| head`
        # Python writes the rest at its end.
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
        sys.exit(PIPE_CLOSED)
    except BaseException as error:
        if not (isinstance(error, KeyboardInterrupt) or is_shut_down()):
            raise
        print(farewell, file=sys.stderr)
        sys.exit(INTERRUPTED)


def time_entered() -> int:
    """Return the wall time at which the command was entered in a terminal, in [ns].

    A shell makes a process for each command that is entered, which rosrun and Python
    run in one after the other. The process may have run other commands before, as those
    of ``bash -c``: the time is at most ``MAX_START`` before Python began, and without a
    terminal it is that.
    """
    if not os.isatty(0):
        return IMPORTED
    with open("/proc/self/stat") as file:
        ticks = int(file.read().rpartition(")")[2].split()[19])
    begin = ticks / os.sysconf("SC_CLK_TCK")
    elapsed = time.clock_gettime(time.CLOCK_BOOTTIME) - begin
    return max(time.time_ns() - round(1e9 * elapsed), IMPORTED - MAX_START)


def is_shut_down() -> bool:
    """Return whether a signal shut the node down, which causes further errors."""
    rospy = sys.modules.get("rospy")
    return rospy is not None and rospy.core.is_shutdown_requested()


def _come_again(ignored: Any) -> None:
    """Send an interrupt again that Python ignored in a callback.

    Args:
        ignored: As for ``sys.unraisablehook``.
    """
    if not issubclass(ignored.exc_type, KeyboardInterrupt):
        sys.__unraisablehook__(ignored)
        return
    # From another thread: here it would be ignored again.
    main, send = threading.main_thread().ident, _thread.interrupt_main
    if hasattr(signal, "pthread_kill"):  # which also ends a call that waits
        send = partial(signal.pthread_kill, main, signal.SIGINT)
    timer = threading.Timer(AGAIN, send)
    timer.daemon = True
    timer.start()


def _end_at_once(*_: object) -> NoReturn:
    """Exit before the command has begun, or after it has ended."""
    os._exit(INTERRUPTED)


def _answer_interrupt(handler: Callable[..., Any]) -> None:
    """Set the handler of Ctrl-C, unless the parent ignores it."""
    if signal.getsignal(signal.SIGINT) is not signal.SIG_IGN:
        signal.signal(signal.SIGINT, handler)
