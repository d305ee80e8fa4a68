"""Files that users drop on the page.

A browser opens a connection for each, names the file and its size in the address,
waits for ``ready``, sends it in pieces, and gets one sentence back.
"""

from __future__ import annotations

import asyncio
import json
import logging
import re
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from pathlib import Path
from secrets import token_hex
from tempfile import TemporaryDirectory
from typing import Callable
from urllib.parse import parse_qs

from websockets.asyncio.server import ServerConnection
from websockets.exceptions import ConnectionClosed

from g1_description.errors import G1DescriptionError, PageServerError, cause

MAX_AT_ONCE = 4
"""Most files on their way or being read."""

PIECE_TIMEOUT = 60.0
"""How long the next piece may take, in [s]: pages on slow machines hang at first."""

MAX_NAME = 120
"""Longest name of a file in messages, in characters."""

SUFFIX = re.compile(r"(\.[A-Za-z0-9]{1,10}){1,2}$")

OnFile = Callable[[str, Path], str]
"""Takes a file's name and where it lies for now; returns what to tell the person."""

log = logging.getLogger(__name__)


class Uploads:
    """Takes files, a few at once."""

    def __init__(self, on_file: OnFile | None, max_size: int) -> None:
        """Take none yet.

        Args:
            on_file: Called with each file in a thread of its own; None: none is taken.
            max_size: Of a file, in bytes.
        """
        self._on_file = on_file
        self._max_size = max_size
        self._threads = ThreadPoolExecutor(MAX_AT_ONCE, "upload")
        self._n_running = 0

    def close(self) -> None:
        """Take no more."""
        self._threads.shutdown(wait=False)

    async def receive(self, browser: ServerConnection, query: str) -> None:
        """Receive one file, and tell the browser what came of it.

        Args:
            browser: Its connection.
            query: Of its address: ``name`` and ``size``.
        """
        self._n_running += 1
        try:
            state, text = "done", await self._take(browser, query)
        except asyncio.TimeoutError:
            state, text = "failed", "The upload stalled."
        except G1DescriptionError as error:
            state, text = "failed", str(error)
        except ConnectionClosed:
            return
        finally:
            self._n_running -= 1
        with suppress(ConnectionClosed):
            await browser.send(json.dumps({"state": state, "text": text}))

    async def _take(self, browser: ServerConnection, query: str) -> str:
        """Receive a file, hand it on, and return what came of it."""
        fields = parse_qs(query)
        name = clean_name(fields.get("name", [""])[0])
        size = self._allowed_size(name, fields.get("size", [""])[0])
        await browser.send(json.dumps({"state": "ready"}))
        with TemporaryDirectory(prefix="g1_description_upload_") as folder:
            found = SUFFIX.search(name)
            suffix = found.group() if found else ""
            # A name that no sentence has: the person's own takes its place there.
            path = Path(folder, f"upload_{token_hex(4)}{suffix}")
            await self._store(browser, path, size)
            loop = asyncio.get_running_loop()
            return await loop.run_in_executor(self._threads, self._hand_on, name, path)

    def _allowed_size(self, name: str, announced: str) -> int:
        """Return the size of a file that is taken, as its browser announces it.

        Raises:
            PageServerError: If it is not taken.
        """
        if self._on_file is None:
            raise PageServerError("this page is read-only: files cannot be uploaded")
        if self._n_running > MAX_AT_ONCE:
            raise PageServerError(
                f"{MAX_AT_ONCE} other files are being read: drop {name} again later"
            )
        if not re.fullmatch(r"[0-9]{1,15}", announced):
            raise PageServerError(f"the browser did not send the size of {name}")
        if int(announced) > self._max_size:
            raise self._too_large(name)
        return int(announced)

    def _too_large(self, name: str) -> PageServerError:
        """Say that a file is too large."""
        return PageServerError(
            f"{name} is larger than {self._max_size / 2**20:.3g} MiB, the limit"
        )

    async def _store(self, browser: ServerConnection, path: Path, size: int) -> None:
        """Write what comes into a file.

        Raises:
            PageServerError: If more comes than was announced, or text.
            asyncio.TimeoutError: If nothing comes for long.
        """
        loop = asyncio.get_running_loop()
        received = 0
        with path.open("wb") as file:
            while received < size:
                piece = await asyncio.wait_for(browser.recv(), PIECE_TIMEOUT)
                received += len(piece)
                if isinstance(piece, str) or received > size:
                    raise PageServerError(
                        "the size of the file differs from the announced one"
                    )
                await loop.run_in_executor(self._threads, file.write, piece)

    def _hand_on(self, name: str, path: Path) -> str:
        """Have a file read; what goes wrong becomes a sentence.

        Raises:
            PageServerError: If it cannot be read.
        """
        assert self._on_file is not None
        try:
            return self._on_file(name, path)
        except G1DescriptionError:
            raise
        except Exception as error:  # whatever it is, the page goes on
            log.exception("cannot read the file %s", name)
            raise PageServerError(f"{name} cannot be read: {cause(error)}") from error


def clean_name(name: str) -> str:
    """Take a file's own name out of what a browser says, fit for messages.

    Args:
        name: With folders of whatever system, control characters, of any length.
    """
    last = re.split(r"[\\/]", name)[-1]
    printable = "".join(letter for letter in last if letter.isprintable()).strip()
    return printable[-MAX_NAME:] or "file"
