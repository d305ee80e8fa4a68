"""Clients of the browser view's server, as browsers and as others that try."""

import http.client
import threading
from contextlib import contextmanager
from typing import NamedTuple
from urllib.parse import urlsplit

import msgspec
import viser
from waiting import DEADLINE, wait_for
from websockets.sync.client import connect

from g1_description.web.server.address import ServerOptions
from g1_description.web.server.page_server import PageServer

SUBPROTOCOL = f"viser-v{viser.__version__}"
TIMEOUT = DEADLINE

HELLO = (
    "GET / HTTP/1.1\r\nHost: localhost\r\nUpgrade: websocket\r\n"
    "Connection: Upgrade\r\nSec-WebSocket-Version: 13\r\n"
    "Sec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n"
    f"Sec-WebSocket-Protocol: {SUBPROTOCOL}\r\n\r\n"
).encode()
"""The beginning of a websocket, as bytes."""


class Answer(NamedTuple):
    """What came over HTTP."""

    status: int
    headers: http.client.HTTPMessage
    body: bytes


@contextmanager
def running(show):
    """Run a page in a thread; give it."""
    thread = threading.Thread(target=show.run)
    thread.start()
    try:
        yield show
    finally:
        show.stop()
        thread.join()


@contextmanager
def opened(**options):
    """Open a page at a free port, and close it again."""
    server = PageServer(ServerOptions(**{"port": 0, **options}))
    try:
        yield server
    finally:
        server.close()


def netloc(server):
    """Give host and port of a page at which this machine reaches it."""
    return f"127.0.0.1:{urlsplit(server.address).port}"


def fetch(server, path="/", **headers):
    """Request something over HTTP."""
    connection = http.client.HTTPConnection(netloc(server), timeout=TIMEOUT)
    try:
        connection.putrequest("GET", path, skip_host="Host" in headers)
        for name, value in headers.items():
            connection.putheader(name.replace("_", "-"), value)
        connection.endheaders()
        response = connection.getresponse()
        return Answer(response.status, response.headers, response.read())
    finally:
        connection.close()


def join(server, path="/", **options):
    """Open a websocket as the page does.

    It is closed soon: this client finds no answer to that behind messages not read.
    """
    options = {"subprotocols": [SUBPROTOCOL], "compression": None, **options}
    options = {
        "max_size": None,
        "open_timeout": TIMEOUT,
        "close_timeout": 0.1,
        **options,
    }
    return connect(f"ws://{netloc(server)}{path}", **options)


def message(kind, **fields):
    """Pack a message of viser's page."""
    return msgspec.msgpack.encode({"type": kind, **fields})


def wait_until_left(server):
    """Wait until all have left, and viser has done what they sent."""
    states = server.viser._websock_server._client_state_from_id
    wait_for(lambda: not server.browsers and not states, "all have left")
