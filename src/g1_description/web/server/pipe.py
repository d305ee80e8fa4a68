"""The way between a browser and viser, both directions, no faster than either takes.

Each side is read only when the other has taken what came before, so that a browser
that does not read costs a few messages of memory and holds up nobody else: viser packs
for each connection what is newest when that one takes it.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable, Coroutine
from typing import Any

from websockets.asyncio.client import ClientConnection, connect
from websockets.asyncio.server import ServerConnection
from websockets.exceptions import ConnectionClosed
from websockets.frames import CloseCode

from g1_description.web.server.hidden_viser import HiddenViser

MAX_QUEUE = 2
"""Most messages read ahead of what the other side has taken."""

STALL_TIMEOUT = 30.0
"""How long a browser may take nothing while something waits for it, in [s]."""


class Pipe:
    """What connects one browser with viser."""

    def __init__(
        self,
        browser: ServerConnection,
        is_read_only: bool,
        quiet: logging.Logger,
    ) -> None:
        """Prepare it.

        Args:
            browser: The browser's connection.
            is_read_only: Whether nothing that it sends goes on to viser.
            quiet: Where the connection to viser logs.
        """
        self._browser = browser
        self._is_read_only = is_read_only
        self._quiet = quiet
        self._loop = asyncio.get_running_loop()

    async def run(self, viser: HiddenViser, on_sent: Callable[[int], None]) -> None:
        """Pass messages on until either side closes.

        Args:
            viser: Where they go.
            on_sent: Told the size of each message that the browser has taken.
        """
        async with connect(
            viser.url,
            subprotocols=[viser.subprotocol],  # type: ignore[list-item]
            additional_headers=viser.headers,
            compression=None,
            max_size=None,
            max_queue=MAX_QUEUE,
            ping_interval=None,  # viser asks
            close_timeout=1,
            logger=self._quiet,
        ) as scene:
            await _until_one_ends(self._down(scene, on_sent), self._up(scene))

    async def _down(
        self, scene: ClientConnection, on_sent: Callable[[int], None]
    ) -> None:
        """Pass viser's messages on to the browser."""
        async for message in scene:
            self._timer = self._loop.call_later(STALL_TIMEOUT, self._end_stalled, 0)
            try:
                await self._browser.send(message)
            finally:
                self._timer.cancel()
            on_sent(len(message))

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
