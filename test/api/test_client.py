"""The client tells at once, or in time, that there is no master."""

import math
import socket
import time

import pytest
from waiting import DEADLINE

from ports import free_port

pytest.importorskip("rospy", reason="rospy is not there")
pytest.importorskip("g1_description.srv", reason="no workspace is sourced")

from g1_description import Client
from g1_description.errors import G1DescriptionError, InvalidValueError


def refused(timeout=DEADLINE):
    """Return why there is no client, and how long that took, in [s]."""
    begin = time.monotonic()
    with pytest.raises(G1DescriptionError) as found:
        Client(timeout=timeout)
    assert "\n" not in str(found.value)
    return str(found.value), time.monotonic() - begin


@pytest.fixture
def port():
    """Give a port that takes connections and never answers."""
    with socket.socket() as listener:
        listener.bind(("127.0.0.1", 0))
        listener.listen(5)
        yield listener.getsockname()[1]


def test_without_a_master_it_does_not_wait(monkeypatch):
    uri = f"http://127.0.0.1:{free_port()}"
    monkeypatch.setenv("ROS_MASTER_URI", uri)
    text, duration = refused()
    assert text.startswith(f"No ROS master at {uri}: ")
    assert duration < 0.5 * DEADLINE


def test_a_master_that_never_answers_is_given_up(monkeypatch, port):
    monkeypatch.setenv("ROS_MASTER_URI", f"http://127.0.0.1:{port}")
    text, duration = refused(0.5)
    assert "timed out" in text
    assert duration < 0.5 * DEADLINE
    assert socket.getdefaulttimeout() is None


@pytest.mark.parametrize("uri", ["http://", "127.0.0.1:11311", "http://host:name", ""])
def test_an_address_that_is_none_is_told(monkeypatch, uri):
    monkeypatch.setenv("ROS_MASTER_URI", uri)
    assert "http://HOST:PORT" in refused()[0]


@pytest.mark.parametrize("timeout", [-1.0, math.nan, math.inf])
def test_a_timeout_is_a_time(timeout):
    with pytest.raises(InvalidValueError, match="timeout must be at least 0 s"):
        Client(timeout=timeout)
