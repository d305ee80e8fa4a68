"""Connections end without an answer, and calls do not wait for ever."""

import contextlib
import socket
import time
import xmlrpc.client

import pytest
from waiting import DEADLINE

pytest.importorskip("rospy", reason="rospy is not installed")

from rospy.impl.tcpros_base import TCPROSTransport, TCPROSTransportProtocol

from g1_description.ros.transport import broken_networks
from g1_description.ros.transport.broken_connections import _state

MUTE = 0.2
"""Time in [s] for which nobody answers."""


@pytest.fixture
def mended(monkeypatch):
    """Change rospy's connections, and undo it after the test."""
    monkeypatch.setattr(TCPROSTransport, "connect", TCPROSTransport.connect)
    monkeypatch.setattr(TCPROSTransport, "socket", None, raising=False)
    transport = xmlrpc.client.Transport
    monkeypatch.setattr(transport, "make_connection", transport.make_connection)
    broken_networks.mend_broken_networks()


@pytest.fixture
def mute():
    """Listen at an address and say nothing."""
    with socket.create_server(("127.0.0.1", 0)) as server:
        yield server


def node_at(address):
    """Make a client of a node's slave API."""
    return xmlrpc.client.ServerProxy("http://{}:{}".format(*address))


def option(sock, name):
    """Read one of TCP's options."""
    return sock.getsockopt(socket.IPPROTO_TCP, name)


@pytest.mark.parametrize(
    ("is_own", "dead_after"),
    [
        (True, broken_networks.DEAD_AFTER),
        (False, broken_networks.CALLER_DEAD_AFTER),
    ],
)
def test_each_connection_of_rospy_ends_without_an_answer(
    mended, mute, is_own, dead_after
):
    transport = TCPROSTransport(TCPROSTransportProtocol("/topic", None), "/topic")
    if is_own:
        transport.dest_address = mute.getsockname()
    with socket.create_connection(mute.getsockname()) as sock:
        transport.socket = sock
        assert transport.socket is sock
        assert sock.getsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE) == 1
        assert option(sock, socket.TCP_USER_TIMEOUT) == 1000 * dead_after
        assert option(sock, socket.TCP_KEEPIDLE) == broken_networks.IDLE
        with contextlib.suppress(OSError):  # systems before Linux 6.15
            longest = option(sock, broken_networks.TCP_RTO_MAX_MS)
            assert longest == 1000 * broken_networks.TRY_PERIOD


def test_an_answer_has_a_time_limit(mended, mute):
    node = node_at(mute.getsockname())
    begin = time.monotonic()
    with broken_networks.answers_within(MUTE), pytest.raises(OSError, match="time"):
        node.getPid("/test")
    assert time.monotonic() - begin < DEADLINE


def test_a_call_without_a_limit_has_that_of_the_process(mended, mute):
    before = socket.getdefaulttimeout()
    socket.setdefaulttimeout(MUTE)
    try:
        with pytest.raises(OSError, match="time"):
            node_at(mute.getsockname()).hello()
    finally:
        socket.setdefaulttimeout(before)


def test_who_refuses_is_asked_once(mended, mute):
    address = mute.getsockname()
    mute.close()
    begin = time.monotonic()
    with pytest.raises(ConnectionRefusedError):
        node_at(address).hello()
    assert time.monotonic() - begin < DEADLINE


def test_the_state_of_a_connection_is_read_where_linux_has_it(mute):
    """Data has just come, and nothing is asked; a little later it is older."""
    sock = socket.create_connection(mute.getsockname())
    with sock, mute.accept()[0] as other:
        other.sendall(b"data")
        assert sock.recv(4) == b"data"
        unanswered, silence = _state(sock)
        assert unanswered == 0
        begin = time.monotonic()
        while _state(sock)[1] < silence + 100:
            assert time.monotonic() < begin + DEADLINE
        assert 0.05 < time.monotonic() - begin < 60.0  # it counts in [ms]
