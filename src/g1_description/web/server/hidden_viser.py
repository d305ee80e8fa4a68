"""viser's own server, silent and where browsers do not find it.

It lets anybody in, so it listens at a random loopback address and port, and serves
only connections that bring a secret, none of which may open viser's tunnel to the
internet. For that this module leans on insides of the pinned version: ``_messages`` and
``_websock_server`` with its ``on_client_connect``, ``_live_connections`` and
``unregister_handler``.
"""

from __future__ import annotations

import asyncio
import logging
import secrets
import socket
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import rich
import viser
from viser._messages import EnableLightsMessage, ShareUrlRequest

LOGGER = "websockets.server"
"""Where viser's connections log, those of the rest of the program too."""

SECRET_HEADER = "X-G1-Description"
SLOW_HEADER = "X-G1-Slow"
"""Of browsers that draw in software: they get no shadows, which are three quarters of
their work."""

log = logging.getLogger(__name__)


class HiddenViser:
    """A viser server behind the gateway."""

    def __init__(self) -> None:
        self._secret = secrets.token_urlsafe()
        self.headers = {SECRET_HEADER: self._secret}
        """Headers that a connection must have."""
        host = _secret_host()
        with _silent():
            self.server = viser.ViserServer(host=host, port=0, verbose=False)
        self.server.gui.configure_theme(show_share_button=False)
        self.server.get_event_loop().set_exception_handler(_on_exception)
        self._connections: Any = self.server._websock_server
        self._connections.on_client_connect(self._check)
        # It would publish this port on the internet.
        self._connections.unregister_handler(ShareUrlRequest)
        logging.getLogger(LOGGER).addFilter(self._is_of_others)
        self.url = f"ws://{host}:{self.server.get_port()}/"
        self.subprotocol = f"viser-v{viser.__version__}"

    def close(self) -> None:
        """Stop it."""
        with _silent():
            self.server.stop()
        logging.getLogger(LOGGER).removeFilter(self._is_of_others)

    def _is_of_others(self, record: logging.LogRecord) -> bool:
        """Tell whether a record is not of viser's connections, which come and go."""
        return record.thread != self._connections._server_thread.ident

    async def _check(self, client: Any) -> None:
        """End a connection that is not the gateway's, before it is listened to.

        One of a slow browser gets no shadows.
        """
        connection = self._connections._live_connections[client.client_id]
        brought = connection.request.headers.get_all(SECRET_HEADER)
        if brought != [self._secret]:
            await connection.close()
        elif SLOW_HEADER in connection.request.headers:
            client.queue_message(EnableLightsMessage(True, False))


def _secret_host() -> str:
    """Choose a loopback address; on systems with only one, that."""
    numbers = [secrets.choice(range(1, 255)) for _ in range(3)]
    host = "127." + ".".join(map(str, numbers))
    with socket.socket() as probe:
        try:
            probe.bind((host, 0))
        except OSError:  # viser would try a thousand ports, and then wait for ever
            return "127.0.0.1"
    return host


@contextmanager
def _silent() -> Iterator[None]:
    """Keep viser from telling an address that is of no use to people."""
    console, logger = rich.get_console(), logging.getLogger(LOGGER)
    before = console.quiet, logger.disabled
    console.quiet = logger.disabled = True
    try:
        yield
    finally:
        console.quiet, logger.disabled = before


def _on_exception(_: asyncio.AbstractEventLoop, context: dict[str, Any]) -> None:
    """Log what a browser's message came to, a value of the wrong kind for example."""
    error = context.get("exception")
    log.debug("viser: %s", error or context.get("message"), exc_info=error)
