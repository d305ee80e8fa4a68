"""Options of the page's server, its socket and its address."""

from __future__ import annotations

import errno
import ipaddress
import os
import socket
from dataclasses import dataclass

from g1_description.choices import MAX_PORT
from g1_description.errors import PageServerError, cause

MAX_BROWSERS = 32
"""Most pages open at once. Each costs the scene's updates, packed for it alone."""


@dataclass(frozen=True)
class ServerOptions:
    """Choices of a program for its page."""

    host: str = "127.0.0.1"
    """Name or address to listen on; all but loopback addresses require a token."""

    port: int = 8080
    """0 takes a free one."""

    read_only: bool = False
    """Whether the page only shows: nothing that a browser sends has any effect."""

    max_browsers: int = MAX_BROWSERS
    """Most pages open at once."""

    token: str = ""
    """Token to open the page; empty: generated if required."""


def listen(host: str, port: int) -> socket.socket:
    """Open the socket that browsers connect to.

    Args:
        host: Name or address of this machine.
        port: 0 for a free one.

    Returns:
        A socket that listens.

    Raises:
        PageServerError: If it cannot listen; the message has the remedy.
    """
    if port not in range(MAX_PORT + 1):
        raise PageServerError(f"port must be from 0 to {MAX_PORT} (got {port})")
    opened = None
    try:
        found = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)
        found.sort(key=lambda entry: entry[0] != socket.AF_INET)
        opened = socket.socket(found[0][0], socket.SOCK_STREAM)
        if os.name == "posix":  # on Windows it takes the port of another program
            opened.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        opened.bind(found[0][4])
        opened.listen(128)
    except (OSError, UnicodeError) as error:
        if opened is not None:
            opened.close()
        raise PageServerError(_why_not(host, port, error)) from None
    return opened


def _why_not(host: str, port: int, error: Exception) -> str:
    """Describe in a sentence why nothing listens, and the remedy."""
    number = getattr(error, "errno", None)
    if number == errno.EADDRINUSE:
        return f"port {port} of {host} is in use; choose another port, or 0 for any"
    if number == errno.EACCES:
        return f"no permission for port {port} of {host}; choose one above 1023"
    return (
        f"cannot listen on {host!r} ({cause(error)}); use an address of this machine: "
        "127.0.0.1 for local access, 0.0.0.0 for all interfaces"
    )


def is_loopback(opened: socket.socket) -> bool:
    """Tell whether only this machine reaches a socket."""
    address = opened.getsockname()[0].partition("%")[0]
    return ipaddress.ip_address(address).is_loopback


def origin(host: str, opened: socket.socket) -> str:
    """Say what people open: scheme, host and port.

    Args:
        host: As the program chose it.
        opened: The socket that listens there.
    """
    address, port = opened.getsockname()[:2]
    if ipaddress.ip_address(address.partition("%")[0]).is_unspecified:
        host = _own_address()
    return f"http://[{host}]:{port}" if ":" in host else f"http://{host}:{port}"


def _own_address() -> str:
    """Guess at which address others reach this machine.

    It is the one that the way to a foreign network begins at. Nothing is sent: a UDP
    socket only looks its route up. 192.0.2.1 is an address that documents use.
    """
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.connect(("192.0.2.1", 9))
            return str(probe.getsockname()[0])
        except OSError:
            return socket.gethostname()
