"""The public server: access control, routing, and forwarding to viser."""

from __future__ import annotations

import asyncio
import logging
import socket
import threading
import weakref
from collections.abc import Callable, Coroutine
from concurrent.futures import Future
from http import HTTPStatus
from typing import Any

from websockets.asyncio.client import ClientConnection, connect
from websockets.asyncio.server import ServerConnection, serve
from websockets.exceptions import ConnectionClosed
from websockets.frames import CloseCode
from websockets.http11 import Request, Response

from g1_description.errors import PageServerError, cause
from g1_description.web.server.address import ServerOptions
from g1_description.web.server.hidden_viser import SLOW_HEADER, HiddenViser
from g1_description.web.server.pages import Admission, ScriptedPage, sentence

MAX_QUEUE = 2
"""Most messages read ahead of what the other side has taken."""

STALL_TIMEOUT = 30.0
"""How long a browser may take nothing while something waits for it, in [s]."""


SLOW_COOKIE = "g1_slow=1"
"""Set by the page's script where the browser draws in software."""

log = logging.getLogger(__name__)
quiet = logging.getLogger(__name__ + ".connections")
quiet.disabled = True  # websockets logs a traceback for each request it cannot read


class Pipe:
    """A connection between one browser and viser."""

    def __init__(self, browser: ServerConnection, is_read_only: bool) -> None:
        """Prepare it.

        Args:
            browser: The browser's connection.
            is_read_only: Whether nothing that it sends goes on to viser.
        """
        self._browser = browser
        self._is_read_only = is_read_only
        self._loop = asyncio.get_running_loop()

    async def run(self, viser: HiddenViser) -> None:
        """Pass messages on to viser and back until either side closes."""
        assert self._browser.request is not None
        cookies = "; ".join(self._browser.request.headers.get_all("Cookie"))
        slow = {SLOW_HEADER: "1"} if SLOW_COOKIE in cookies.split("; ") else {}
        async with connect(
            viser.url,
            subprotocols=[viser.subprotocol],  # type: ignore[list-item]
            additional_headers={**viser.headers, **slow},
            compression=None,
            max_size=None,
            max_queue=MAX_QUEUE,
            ping_interval=None,  # viser asks
            close_timeout=1,
            logger=quiet,
        ) as scene:
            await _until_one_ends(self._down(scene), self._up(scene))

    async def _down(self, scene: ClientConnection) -> None:
        """Pass viser's messages on to the browser."""
        async for message in scene:
            self._timer = self._loop.call_later(STALL_TIMEOUT, self._end_stalled, 0)
            try:
                await self._browser.send(message)
            finally:
                self._timer.cancel()

    def _end_stalled(self, before: int) -> None:
        """End a connection through which nothing goes, else look again later."""
        waiting = self._browser.transport.get_write_buffer_size()
        if before and waiting >= before:
            self._browser.transport.abort()
        else:
            self._timer = self._loop.call_later(
                STALL_TIMEOUT, self._end_stalled, waiting
            )

    async def _up(self, scene: ClientConnection) -> None:
        """Pass the browser's messages on to viser, unless the page only shows."""
        async for message in self._browser:
            if not self._is_read_only:
                await scene.send(message)


async def _until_one_ends(*ways: Coroutine[Any, Any, None]) -> None:
    """Run both directions until one ends, and end the other."""
    tasks = [asyncio.ensure_future(way) for way in ways]
    try:
        await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
    finally:
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)


async def refuse(browser: ServerConnection, code: CloseCode, why: str) -> None:
    """Close a connection; whoever does not take part in that is cut off.

    Args:
        browser: The connection.
        code: What kind of reason there is.
        why: The reason, at most 123 bytes.
    """
    timer = asyncio.get_running_loop().call_later(5.0, browser.transport.abort)
    try:
        await browser.close(code, why)
    except ConnectionClosed:
        pass
    finally:
        timer.cancel()


MAX_MESSAGE = 16 * 2**20
"""Largest message of a browser, in bytes: a picture of the scene is one."""

OPEN_TIMEOUT = 10.0
"""Longest time of a browser for its request, in [s]."""

PAGE_TIMEOUT = 120.0
"""How long a browser may take to receive the page, in [s]."""

WARNING_PERIOD = 60.0
"""Least time between warnings, in [s]: others decide how often there is a reason."""


class Gateway:
    """Stands before viser, in a thread of its own.

    Attributes:
        browsers: How many show the page.
    """

    def __init__(
        self,
        options: ServerOptions,
        hidden: HiddenViser,
        admission: Admission,
        page: ScriptedPage,
    ) -> None:
        """Prepare it.

        Args:
            options: What the program chose.
            hidden: viser, to which browsers are connected.
            admission: Who may come in.
            page: The answer over HTTP.
        """
        self.browsers = 0
        self._options = options
        self._hidden = hidden
        self._admission = admission
        self._page = page
        self._next_warning = 0.0
        self._opened: Future[None] = Future()

    def open(self, listening: socket.socket) -> None:
        """Serve from now on, at a socket that listens.

        Raises:
            PageServerError: If that cannot be.
        """
        self._thread = threading.Thread(
            target=self._run, args=(listening,), name="gateway", daemon=True
        )
        self._thread.start()
        try:
            self._opened.result()
        except Exception as error:
            raise PageServerError(f"cannot serve the page: {cause(error)}") from error

    def close(self) -> None:
        """End all connections."""
        if self._thread.is_alive():
            self._loop.call_soon_threadsafe(self._stopping.set)
            self._thread.join(10.0)

    def _run(self, listening: socket.socket) -> None:
        """Serve until ``close``, or report an error to ``open``."""
        try:
            asyncio.run(self._serve(listening))
        except Exception as error:
            if self._opened.done():
                raise
            self._opened.set_exception(error)

    async def _serve(self, listening: socket.socket) -> None:
        """Serve until ``close``."""
        self._loop = asyncio.get_running_loop()
        self._loop.set_exception_handler(
            lambda _, context: self._warn(str(context.get("message")))
        )
        self._stopping = asyncio.Event()
        own: Any = self._hidden.subprotocol  # of this version alone
        async with serve(
            self._on_connection,
            sock=listening,
            process_request=self._on_request,
            select_subprotocol=lambda _, offered: own if own in offered else None,
            server_header=None,
            compression=None,  # viser's messages are packed
            open_timeout=OPEN_TIMEOUT,
            close_timeout=2,
            max_size=MAX_MESSAGE,
            max_queue=2,
            logger=quiet,
        ) as server:
            self._opened.set_result(None)
            await self._stopping.wait()
            for connection in list(server.handlers):
                self._loop.call_later(1.0, connection.transport.abort)

    async def _on_request(
        self, connection: ServerConnection, request: Request
    ) -> Response | None:
        """Answer a request over HTTP; None for one that goes on as a websocket."""
        path, _, query = request.path.partition("?")
        refused = self._admission.refusal(query, request.headers)
        response: Response | None = None
        if refused is not None:
            self._warn(f"a request was refused: {refused[1]}")
            response = sentence(*refused)
        elif path != "/":
            response = sentence(
                HTTPStatus.NOT_FOUND, "There is nothing at this address."
            )
        elif "websocket" not in ",".join(request.headers.get_all("Upgrade")).lower():
            response = self._page.answer(request.headers, self._admission.cookie())
        elif self.browsers >= self._options.max_browsers:
            response = sentence(HTTPStatus.SERVICE_UNAVAILABLE, self._too_many())
        if response is not None:
            transport = weakref.ref(connection.transport)
            self._loop.call_later(PAGE_TIMEOUT, _abort, transport)
        return response

    def _too_many(self) -> str:
        """Say that no further page may be open."""
        most = self._options.max_browsers
        return f"{most} pages are open, the limit: close one."

    async def _on_connection(self, browser: ServerConnection) -> None:
        """Serve a websocket."""
        if browser.subprotocol != self._hidden.subprotocol:
            why = "Version mismatch: reload the page."
            await refuse(browser, CloseCode.PROTOCOL_ERROR, why)
        elif self.browsers >= self._options.max_browsers:
            await refuse(browser, CloseCode.TRY_AGAIN_LATER, self._too_many())
        else:
            await self._show(browser)

    async def _show(self, browser: ServerConnection) -> None:
        """Connect a browser with viser."""
        self.browsers += 1
        pipe = Pipe(browser, self._options.read_only)
        try:
            await pipe.run(self._hidden)
        except (ConnectionClosed, OSError, asyncio.TimeoutError) as error:
            log.debug("lost the connection to a browser: %s", error)
        finally:
            self.browsers -= 1
        await refuse(browser, CloseCode.GOING_AWAY, "")

    def _warn(self, text: str) -> None:
        """Log a warning, one a minute at most."""
        now = self._loop.time()
        if now >= self._next_warning:
            self._next_warning = now + WARNING_PERIOD
            log.warning("%s", text)


def _abort(transport: Callable[[], Any]) -> None:
    """Cut off a connection that should have ended."""
    found = transport()
    if found is not None:
        found.abort()
