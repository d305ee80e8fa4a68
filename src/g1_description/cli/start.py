"""The start and the end of a command, which a signal may end at any moment.

What takes long to import is imported here, when signals are answered already.
"""

from __future__ import annotations

import importlib
import os
import signal
import sys
import threading
from collections.abc import Callable
from typing import Any, NoReturn

INTERRUPTED = 130
"""Exit code after Ctrl-C, as shells have it."""

AGAIN = 0.05
"""Time in [s] after which an interrupt that was ignored comes again."""


def run(module: str, farewell: str = "interrupted.") -> None:
    """Import a command and run it; end quietly when a signal ends it.

    Args:
        module: Its module in this folder, named as the command; ``main`` does the work
            and may raise KeyboardInterrupt.
        farewell: What the command says then.
    """
    sys.unraisablehook = _come_again
    # Some libraries take an interrupt of their import for something else.
    _answer_interrupt(_end_at_once)
    main = importlib.import_module(f".{module}", __package__).main
    _answer_interrupt(signal.default_int_handler)
    try:
        try:
            main()
        finally:
            # Python has things to do after main; nothing is left to interrupt.
            if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
                _answer_interrupt(_end_at_once)
    except BaseException as error:
        if not (isinstance(error, KeyboardInterrupt) or is_shut_down()):
            raise
        print(f"{module.rpartition('.')[2]}: {farewell}", file=sys.stderr)
        sys.exit(INTERRUPTED)


def is_shut_down() -> bool:
    """Return whether a signal shut the node down: what fails then fails of that."""
    rospy = sys.modules.get("rospy")
    return rospy is not None and rospy.core.is_shutdown_requested()


def _come_again(ignored: Any) -> None:
    """Interrupt again where Python ignores an interrupt: in callbacks of its own.

    Args:
        ignored: What ``sys.unraisablehook`` is given.
    """
    if not issubclass(ignored.exc_type, KeyboardInterrupt):
        sys.__unraisablehook__(ignored)
        return
    # From elsewhere: here it would be ignored again.
    main = threading.main_thread().ident
    timer = threading.Timer(AGAIN, signal.pthread_kill, (main, signal.SIGINT))
    timer.daemon = True
    timer.start()


def _end_at_once(*_: object) -> NoReturn:
    """End the program before it has done anything, or after it has done all."""
    os._exit(INTERRUPTED)


def _answer_interrupt(handler: Callable[..., Any]) -> None:
    """Set what Ctrl-C does, unless whoever started this ignores it."""
    if signal.getsignal(signal.SIGINT) is not signal.SIG_IGN:
        signal.signal(signal.SIGINT, handler)
