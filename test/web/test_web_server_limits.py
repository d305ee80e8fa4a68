"""Browsers that are many, slow or mad, and what is no browser, harm nobody."""

import os
import socket
from contextlib import contextmanager
from pathlib import Path

import pytest

pytest.importorskip("viser", reason="viser is not there")

import numpy as np
from web_clients import (
    HELLO,
    TIMEOUT,
    fetch,
    join,
    netloc,
    opened,
    wait_until,
    wait_until_left,
)
from websockets.exceptions import InvalidStatus

from g1_description.web.server import gateway

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def server():
    with opened(max_browsers=5) as server:
        server.viser.scene.add_box("/box", dimensions=(1, 1, 1), color=(9, 9, 9))
        yield server


def raw(server, data=b""):
    """Open a connection, and send something."""
    host, port = netloc(server).split(":")
    client = socket.create_connection((host, int(port)), timeout=TIMEOUT)
    client.sendall(data)
    return client


def test_one_more_than_may_be_is_told(server):
    pages = [join(server) for _ in range(5)]
    with pytest.raises(InvalidStatus) as caught:
        join(server)
    assert caught.value.response.status_code == 503
    assert (
        caught.value.response.body == b"5 pages are open, which is the most: close one."
    )
    pages[0].close()
    wait_until(lambda: server.browsers == 4, "one has left")
    pages[0] = join(server)
    for page in pages:
        assert page.recv(timeout=TIMEOUT)
        page.close()
    wait_until_left(server)


GARBAGE = [
    b"",
    b"\r\n\r\n",
    b"GET",
    b"POST / HTTP/1.1\r\nHost: localhost\r\nContent-Length: 9\r\n\r\n",
    b"GET / HTTP/1.0\r\n\r\n",
    b"\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03" + bytes(range(256)),
    bytes(range(256)) * 64,
    b"GET /" + b"a" * 100000 + b" HTTP/1.1\r\n\r\n",
    b"GET / HTTP/1.1\r\n" + b"A: b\r\n" * 500 + b"\r\n",
    HELLO[:60],
    HELLO + b"\xff" * 99,
    HELLO + b"\x82\x05abcde",  # not masked
    HELLO.replace(b"Version: 13", b"Version: 99"),
    HELLO.replace(b"dGhlIHNhbXBsZSBub25jZQ==", b"short"),
]


def test_garbage_is_not_even_told_about(server, capfd, caplog):
    for data in GARBAGE:
        client = raw(server)
        try:
            client.sendall(data)
            client.shutdown(socket.SHUT_WR)
            while client.recv(65536):
                pass
        except OSError:  # it has closed already
            pass
        client.close()
    for _ in range(200):
        raw(server, HELLO[:40]).close()
        raw(server, HELLO).close()
    wait_until_left(server)
    assert fetch(server).status == 200
    with join(server) as page:
        assert page.recv(timeout=TIMEOUT)
    assert capfd.readouterr() == ("", "")
    assert len(caplog.records) <= 1


def test_warnings_are_few(caplog):
    with opened() as server:
        for _ in range(20):
            fetch(server, Host="evil.example")
    assert len(caplog.records) == 1
    assert "a request was refused" in caplog.text


def test_who_says_nothing_is_cut_off(monkeypatch):
    monkeypatch.setattr(gateway, "OPEN_TIMEOUT", 0.2)
    with opened() as server, raw(server, HELLO[:60]) as client:
        assert client.recv(99) == b""


def test_who_does_not_take_an_answer_is_cut_off(monkeypatch):
    monkeypatch.setattr(gateway, "PAGE_TIMEOUT", 0.2)
    texts = {"long": lambda: "x" * 2**24}
    with opened(texts=texts) as server, raw(server) as client:
        client.sendall(b"GET /long HTTP/1.1\r\nHost: localhost\r\n\r\n")
        assert client.recv(12) == b"HTTP/1.1 200"
        n_open = n_files()
        wait_until(lambda: n_files() < n_open, "it is cut off")


def n_files():
    """Count the files and sockets of this process."""
    return len(os.listdir("/proc/self/fd"))


@contextmanager
def with_lazy(server):
    """Open a page that reads nothing."""
    with raw(server) as lazy:
        lazy.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        lazy.sendall(HELLO)
        assert lazy.recv(12) == b"HTTP/1.1 101"
        wait_until(lambda: server.browsers == 1, "it is there")
        yield


def send_points(server, number):
    """Send a new state of the scene to all; return its size."""
    points = np.full((2**16, 3), number, np.float32)
    server.viser.scene.add_point_cloud("/p", points, (9, 9, 9))
    return points.nbytes / 2  # viser halves the precision


def memory():
    """Measure the memory of this process, in bytes."""
    pages = Path("/proc/self/statm").read_text(encoding="ascii").split()[1]
    return int(pages) * os.sysconf("SC_PAGE_SIZE")


def test_who_does_not_read_costs_little_and_holds_up_nobody():
    """60 MB are sent to the one who reads."""
    with opened() as server, with_lazy(server), join(server) as reader:
        for number in range(160):
            size = send_points(server, number)
            while len(reader.recv(timeout=TIMEOUT)) < size:
                pass
            if number == 20:
                before = memory()
        assert server.browsers == 2
        assert memory() - before < 16 * 2**20


def test_who_does_not_read_is_cut_off(monkeypatch):
    monkeypatch.setattr(gateway, "STALL_TIMEOUT", 0.1)
    with opened() as server, with_lazy(server):
        for number in range(40):
            send_points(server, number)
            server.viser.flush()
        wait_until(lambda: server.browsers == 0, "it is cut off")
