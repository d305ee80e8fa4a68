"""Ctrl-C ends a command also where Python ignores the first one."""

import signal
import sys
import threading
import time
from types import SimpleNamespace

import pytest
from waiting import DEADLINE

from g1_description.cli import start as command_start


def test_an_interrupt_that_python_ignored_comes_again(capfd):
    begin = time.monotonic()
    # A shell may have let it be ignored, as for what runs in the background.
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        with pytest.raises(KeyboardInterrupt):
            command_start._come_again(SimpleNamespace(exc_type=KeyboardInterrupt))
            threading.Event().wait(DEADLINE)
    finally:
        signal.signal(signal.SIGINT, before)
    assert time.monotonic() < begin + DEADLINE
    assert capfd.readouterr().err == ""


def test_other_exceptions_that_python_ignored_are_told(capfd):
    class Careless:
        def __del__(self):
            raise ValueError("dropped")

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("sys.unraisablehook", command_start._come_again)
        Careless()
    assert "ValueError: dropped" in capfd.readouterr().err


@pytest.mark.parametrize(
    ("error", "is_down", "end"),
    [
        (None, False, None),
        (KeyboardInterrupt(), False, SystemExit),
        (RuntimeError("no node"), True, SystemExit),
        (RuntimeError("no node"), False, RuntimeError),
        (SystemExit(2), False, SystemExit),
    ],
)
def test_only_signals_end_it_quietly(monkeypatch, capsys, error, is_down, end):
    """After the command there is only Python's work, which a signal ends at once."""
    handlers = []

    def main():
        handlers.append(signal.getsignal(signal.SIGINT))
        if error:
            raise error

    module = SimpleNamespace(main=main)
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    with monkeypatch.context() as patch:
        patch.setitem(sys.modules, "g1_description.cli.try", module)
        patch.setattr(sys, "unraisablehook", None)
        patch.setattr(command_start, "is_shut_down", lambda: is_down)
        try:
            if end is None:
                command_start.run("try")
            else:
                with pytest.raises(end) as ended:
                    command_start.run("try", "over.")
            handlers.append(signal.getsignal(signal.SIGINT))
            assert sys.unraisablehook is command_start._come_again
        finally:
            signal.signal(signal.SIGINT, before)
    assert handlers == [signal.default_int_handler, command_start._end_at_once]
    is_quiet = isinstance(error, KeyboardInterrupt) or is_down
    assert capsys.readouterr().err == ("try: over.\n" if is_quiet else "")
    if is_quiet:
        assert ended.value.code == 130
    elif end:
        assert ended.value is error
