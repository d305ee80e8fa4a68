"""Answers over HTTP: viser's page with our script."""

from __future__ import annotations

import gzip
import hashlib
import re
from collections.abc import Mapping
from http import HTTPStatus
from pathlib import Path

import viser
from websockets.datastructures import Headers
from websockets.http11 import Response

SCRIPT = Path(__file__).parent / "script.js"

HOST = re.compile(r"[\w.\[\]:-]{1,255}", re.ASCII)

SECURITY_HEADERS = {
    "X-Frame-Options": "DENY",
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",  # the address may have the token
    "Cross-Origin-Resource-Policy": "same-origin",
}


def respond(
    status: HTTPStatus, body: bytes, kind: str, more: Mapping[str, str] | None = None
) -> Response:
    """Make an answer.

    Args:
        status: Its status.
        body: Its content.
        kind: The content's type.
        more: Headers beside those that all answers have.
    """
    headers = Headers(SECURITY_HEADERS)
    headers["Content-Type"] = kind
    headers["Content-Length"] = str(len(body))
    headers["Connection"] = "close"
    for name, value in (more or {}).items():
        headers[name] = value
    return Response(status.value, status.phrase, headers, body)


def sentence(status: HTTPStatus, text: str) -> Response:
    """Make an answer of one sentence."""
    kind = "text/plain; charset=utf-8"
    return respond(status, text.encode(), kind, {"Cache-Control": "no-store"})


class ScriptedPage:
    """The page."""

    def __init__(self) -> None:
        """Put the page together.

        Raises:
            OSError: If viser has no page.
        """
        index = Path(viser.__file__).parent / "client" / "build" / "index.html"
        before, end, after = index.read_text(encoding="utf-8").rpartition("</body>")
        ours = f"<script>{SCRIPT.read_text(encoding='utf-8')}</script>"
        self._page = f"{before}{ours}{end}{after}".encode()
        self._packed = gzip.compress(self._page, 6)
        self._tag = f'"{hashlib.sha256(self._page).hexdigest()[:16]}"'

    def answer(self, headers: Headers, cookie: str | None) -> Response:
        """Answer with the page.

        Args:
            headers: Of the request.
            cookie: What the browser shall keep, if anything.
        """
        more = {
            "Content-Security-Policy": _policy(headers["Host"]),
            "Cache-Control": "private, no-cache",
            "ETag": self._tag,
            "Vary": "Accept-Encoding",
        }
        if cookie is not None:
            more["Set-Cookie"] = cookie
        kind = "text/html; charset=utf-8"
        if self._tag in headers.get_all("If-None-Match"):
            return respond(HTTPStatus.NOT_MODIFIED, b"", kind, more)
        if "gzip" in ",".join(headers.get_all("Accept-Encoding")):
            more["Content-Encoding"] = "gzip"
            return respond(HTTPStatus.OK, self._packed, kind, more)
        return respond(HTTPStatus.OK, self._page, kind, more)


def _policy(host: str) -> str:
    """Say what the page may do, for the browser.

    viser's page connects wherever its address says (``?websocket=``), and runs what
    it is told there: a link could hand it to others.

    Args:
        host: Of the page. Older browsers do not know that 'self' has websockets.
    """
    own = f"'self' ws://{host}" if HOST.fullmatch(host) else "'self'"
    return (
        f"connect-src {own} blob: data:; frame-ancestors 'none'; base-uri 'none'; "
        "form-action 'none'; object-src 'none'"
    )
