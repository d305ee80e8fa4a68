"""Signals wait until a block ends, and do then what they would have done."""

import os
import signal
import subprocess
import sys
import threading

import pytest
from waiting import DEADLINE

from g1_description.interrupts import ENDING_SIGNALS, uninterrupted

IMPORT = """
import os, signal, sys
from g1_description.interrupts import uninterrupted
class Hook:
    def find_spec(self, name, path=None, target=None):
        os.kill(os.getpid(), signal.SIGINT)
sys.meta_path.insert(0, Hook())
try:
    with uninterrupted():
        try:
            import nowhere
        except:
            print("lost")
    print("not heard")
except KeyboardInterrupt:
    print("heard")
"""


@pytest.fixture(name="came")
def _came():
    came = []
    before = {number: signal.getsignal(number) for number in ENDING_SIGNALS}
    for number in ENDING_SIGNALS:
        signal.signal(number, lambda number, _: came.append(number))
    yield came
    for number, handler in before.items():
        signal.signal(number, handler)


@pytest.mark.parametrize("number", ENDING_SIGNALS)
def test_a_signal_waits(came, number):
    with uninterrupted():
        os.kill(os.getpid(), number)
        assert not came
    assert came == [number]
    os.kill(os.getpid(), number)
    assert came == [number, number]


def test_many_signals_are_one(came):
    with uninterrupted():
        for number in ENDING_SIGNALS:
            os.kill(os.getpid(), number)
    assert came == [ENDING_SIGNALS[0]]


def test_nothing_comes_where_nothing_came(came):
    with uninterrupted():
        pass
    assert not came


def test_errors_go_on(came):
    with pytest.raises(KeyError), uninterrupted():
        os.kill(os.getpid(), signal.SIGINT)
        raise KeyError
    assert came == [signal.SIGINT]


def test_what_is_ignored_stays_so(came):
    signal.signal(signal.SIGHUP, signal.SIG_IGN)
    with uninterrupted():
        os.kill(os.getpid(), signal.SIGHUP)
    assert signal.getsignal(signal.SIGHUP) == signal.SIG_IGN
    assert not came


def test_threads_do_without():
    done = threading.Event()

    def work():
        with uninterrupted():
            done.set()

    threading.Thread(target=work).start()
    assert done.wait(DEADLINE)


def test_an_import_that_catches_everything_loses_no_interrupt():
    result = subprocess.run(
        [sys.executable, "-c", IMPORT],
        env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
        stdout=subprocess.PIPE,
        text=True,
        check=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.default_int_handler),
        timeout=DEADLINE,
    )
    assert result.stdout.split() == ["lost", "heard"]
