"""Ctrl-C ends a command quietly with 130, whatever it is doing."""

import os
import signal
import subprocess
import sys
import threading
import time
from types import SimpleNamespace

import pytest
from forked import run_forked
from waiting import DEADLINE

from g1_description.cli import start as command_start


def run_command(monkeypatch, main, importing=int, handler=signal.default_int_handler):
    """Run a command in a process of its own, and what its import does."""

    def import_module(name, package):
        importing()
        return SimpleNamespace(main=main)

    def program():
        signal.signal(signal.SIGINT, handler)
        monkeypatch.setattr(command_start.importlib, "import_module", import_module)
        command_start.run("some.command", "interrupted at its work.")

    return run_forked(program)


def interrupt():
    os.kill(os.getpid(), signal.SIGINT)
    threading.Event().wait(DEADLINE)


def fail():
    raise ValueError("at work")


@pytest.mark.parametrize(
    ("main", "importing", "code", "out", "told"),
    [
        (print, interrupt, 130, "", ""),
        (interrupt, int, 130, "", "command: interrupted at its work.\n"),
        (print, int, 0, "\n", ""),
    ],
    ids=["import", "work", "none"],
)
def test_an_interrupt_ends_it_with_130(monkeypatch, main, importing, code, out, told):
    run = run_command(monkeypatch, main, importing)
    assert (run.returncode, run.stdout, run.stderr) == (code, out, told)


def test_other_errors_are_not_interrupts(monkeypatch):
    run = run_command(monkeypatch, fail)
    assert run.returncode == 1 and "ValueError: at work" in run.stderr


def test_errors_after_a_signal_has_ended_the_node_are_quiet(monkeypatch):
    monkeypatch.setattr(command_start, "is_shut_down", lambda: True)
    run = run_command(monkeypatch, fail)
    assert (run.returncode, run.stderr) == (130, "command: interrupted at its work.\n")


def test_a_command_whose_parent_ignores_ctrl_c_ignores_it(monkeypatch):
    def main():
        os.kill(os.getpid(), signal.SIGINT)
        print("goes on")

    run = run_command(monkeypatch, main, handler=signal.SIG_IGN)
    assert (run.returncode, run.stdout, run.stderr) == (0, "goes on\n", "")


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


@pytest.mark.parametrize(
    ("error", "is_down", "end"),
    [
        (None, False, None),
        (KeyboardInterrupt(), False, SystemExit),
        (RuntimeError("no node"), True, SystemExit),
        (RuntimeError("no node"), False, RuntimeError),
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


def test_a_closed_pipe_ends_a_command_quietly(monkeypatch):
    def write():
        reading, writing = os.pipe()
        os.close(reading)
        os.dup2(writing, 1)
        print("much", flush=True)

    run = run_command(monkeypatch, write)
    assert (run.returncode, run.stderr) == (128 + signal.SIGPIPE, "")


HEAVY = {"scipy", "matplotlib", "PIL", "trimesh", "pybullet", "mujoco", "daqp"}
HEAVY |= {"rosbags", "rospy", "rosgraph", "viser", "websockets", "distributed"}


@pytest.mark.parametrize(
    ("words", "unused"),
    [
        (["check", "--help"], {*HEAVY, "numpy", "lxml", "ruamel"}),
        (["play", "--help"], {*HEAVY, "numpy", "lxml", "ruamel"}),
        (["pose", "--help"], {*HEAVY, "numpy", "lxml", "ruamel"}),
        (["motion", "info", "squat.csv"], HEAVY),
        (["check", "squat.csv"], HEAVY - {"scipy", "pybullet", "daqp"}),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, list) else "",
)
def test_a_command_imports_no_library_that_it_does_not_use(words, unused):
    program = (
        "import sys; from g1_description.cli.start import run; "
        f"sys.argv = {words}; run({words[0]!r})"
    )
    command = [sys.executable, "-X", "importtime", "-c", program]
    ended = subprocess.run(command, capture_output=True, text=True, check=False)
    assert ended.returncode == 0, ended.stderr
    lines = (line.split("|") for line in ended.stderr.splitlines())
    imported = {cells[2].split(".")[0].strip() for cells in lines if len(cells) == 3}
    assert "g1_description" in imported and not imported & unused
