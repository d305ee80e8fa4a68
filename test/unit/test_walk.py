"""The benchmark counts the calls of one message as they are made."""

import sys
import threading
from pathlib import Path

import pytest

pytest.importorskip("rospy", reason="rospy is not installed")
sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "tools"))
from bench.walk_node import Recorder


def request():
    """Stand where rospy calls the service."""


def leaf():
    return [number for number in range(3)]


def raises():
    raise ValueError


def walk():
    leaf()
    try:
        raises()
    except ValueError:
        return (lambda: leaf())()


def send():
    leaf()
    request()
    leaf()


def recorded(function):
    recorder = Recorder(__name__, request.__code__)

    def run():
        sys.setprofile(recorder)
        function()
        sys.setprofile(None)

    thread = threading.Thread(target=run)
    thread.start()
    thread.join()
    return [[call.lstrip(":") for call in path] for path in recorder.walks]


def test_a_walk_is_every_call_until_the_first_one_returns():
    assert recorded(walk) == [["walk", "leaf", "raises", "<lambda>", "leaf"]]


def test_a_walk_ends_with_the_request():
    assert recorded(send)[:2] == [["send", "leaf"], ["request", "leaf"]]
