"""Answers over HTTP: viser's page with our script, for those who may see it.

At a loopback address: users of this machine, but not pages of other sites. A page from
elsewhere runs in the same browser, so it can send requests here. It is recognised by
its ``Origin``, or, with DNS rebinding, by ``Host``. At any other address: everybody
with the token.
"""

from __future__ import annotations

import gzip
import hashlib
import hmac
import re
from collections.abc import Mapping
from http import HTTPStatus
from pathlib import Path
from urllib.parse import parse_qs

import viser
from websockets.datastructures import Headers
from websockets.http11 import Response

SCRIPT = Path(__file__).parent / "script.js"

LOOPBACK = re.compile(
    r"(localhost|127(\.\d{1,3}){3}|\[::1\])(:\d{1,5})?", re.IGNORECASE
)
"""Host headers that name this machine; any port, as ssh -L brings its own."""

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


class Admission:
    """The rules of one page."""

    def __init__(self, token: str, base: str, port: int) -> None:
        """Make them.

        Args:
            token: Required token; empty: none.
            base: Scheme, host and port of the page, as people open it.
            port: It listens there, for the name of the cookie: browsers send cookies
                to all ports of a host.
        """
        self._token = token.encode()
        self._base = base
        self._cookie = f"g1_description_{port}"

    def refusal(self, query: str, headers: Headers) -> tuple[HTTPStatus, str] | None:
        """Return status and sentence of a refusal; None if a request is allowed."""
        hosts, origins = headers.get_all("Host"), headers.get_all("Origin")
        if len(hosts) != 1:
            return (HTTPStatus.BAD_REQUEST, "A request must have one Host header.")
        if not self._token and not LOOPBACK.fullmatch(hosts[0]):
            return (
                HTTPStatus.FORBIDDEN,
                "This page accepts only its own machine: open it as localhost or "
                "127.0.0.1, from another machine through ssh -L, or start it with "
                "another host, which creates a token.",
            )
        own = {f"{scheme}://{hosts[0].lower()}" for scheme in ("http", "https")}
        if any(origin.lower() not in own for origin in origins):
            return (
                HTTPStatus.FORBIDDEN,
                "Cross-origin request refused: open this page directly.",
            )
        brought = parse_qs(query).get("token", [])
        for pair in "; ".join(headers.get_all("Cookie")).split(";"):
            name, _, value = pair.strip().partition("=")
            brought += [value] if name == self._cookie else []
        # All are compared, in a time that does not show how much of one is right.
        right = [
            hmac.compare_digest(value.encode("utf-8", "replace"), self._token)
            for value in brought
        ]
        if self._token and not any(right):
            return (
                HTTPStatus.UNAUTHORIZED,
                "This page needs the token that was printed at its start: "
                f"{self._base}/?token=...",
            )
        return None

    def cookie(self) -> str | None:
        """Return the browser's cookie; None without a token."""
        if not self._token:
            return None
        return (
            f"{self._cookie}={self._token.decode()}; Path=/; HttpOnly; SameSite=Strict"
        )


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
