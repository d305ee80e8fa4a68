"""Ctrl-C ends a command also where Python ignores the first one."""

import signal
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
