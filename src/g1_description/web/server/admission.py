"""Access control of the page.

At a loopback address: users of this machine, but not pages of other sites. A page from
elsewhere runs in the same browser, so it can send requests here. It is recognised by
its ``Origin``, or, with DNS rebinding, by ``Host``. At any other address: everybody
with the token.
"""

from __future__ import annotations

import hmac
import re
from dataclasses import dataclass
from http import HTTPStatus
from urllib.parse import parse_qs

from websockets.datastructures import Headers

LOOPBACK = re.compile(
    r"(localhost|127(\.\d{1,3}){3}|\[::1\])(:\d{1,5})?", re.IGNORECASE
)
"""Host headers that name this machine; any port, as ssh -L brings its own."""


@dataclass(frozen=True)
class Refusal:
    """Why a request is not answered."""

    status: HTTPStatus
    sentence: str


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

    def refusal(self, query: str, headers: Headers) -> Refusal | None:
        """Return why a request is refused; None if it is allowed."""
        hosts, origins = headers.get_all("Host"), headers.get_all("Origin")
        if len(hosts) != 1:
            return Refusal(
                HTTPStatus.BAD_REQUEST, "A request must have one Host header."
            )
        if not self._token and not LOOPBACK.fullmatch(hosts[0]):
            return Refusal(
                HTTPStatus.FORBIDDEN,
                "This page accepts only its own machine: open it as localhost or "
                "127.0.0.1, from another machine through ssh -L, or start it with "
                "another host, which creates a token.",
            )
        own = {f"{scheme}://{hosts[0].lower()}" for scheme in ("http", "https")}
        if any(origin.lower() not in own for origin in origins):
            return Refusal(
                HTTPStatus.FORBIDDEN,
                "Cross-origin request refused: open this page directly.",
            )
        if self._token and not self._knows_token(query, headers):
            return Refusal(
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

    def _knows_token(self, query: str, headers: Headers) -> bool:
        """Tell whether a request brings the token, in its address or as a cookie."""
        brought = parse_qs(query).get("token", [])
        for pair in "; ".join(headers.get_all("Cookie")).split(";"):
            name, _, value = pair.strip().partition("=")
            if name == self._cookie:
                brought.append(value)
        # All are compared, in a time that does not tell how much of one is right.
        right = [
            hmac.compare_digest(value.encode("utf-8", "replace"), self._token)
            for value in brought
        ]
        return any(right)
