"""The page's server: viser, and a gateway before it."""

from __future__ import annotations

import atexit
import secrets
from typing import TYPE_CHECKING

from g1_description.errors import PageServerError
from g1_description.interrupts import uninterrupted
from g1_description.libraries import missing
from g1_description.web.server.address import ServerOptions, is_loopback, listen, origin

if TYPE_CHECKING:
    import viser


class PageServer:
    """A page in browsers, which viser fills and a gateway guards.

    Attributes:
        viser: What fills the page.
        address: URL of the page, with the token if required.
    """

    def __init__(self, options: ServerOptions) -> None:
        """Open it.

        Args:
            options: Where, and for whom.

        Raises:
            PageServerError: If viser is not installed, or the port cannot be opened.
        """
        _check_installed()
        from g1_description.web.server.gateway import Gateway
        from g1_description.web.server.hidden_viser import HiddenViser
        from g1_description.web.server.pages import Admission, ScriptedPage

        opened = listen(options.host, options.port)
        base = origin(options.host, opened)
        made = "" if is_loopback(opened) else secrets.token_urlsafe()
        token = options.token or made
        self.address = f"{base}/?token={token}" if token else f"{base}/"
        self._hidden = HiddenViser()
        self.viser: viser.ViserServer = self._hidden.server
        self._gateway = Gateway(
            options,
            self._hidden,
            Admission(token, base, opened.getsockname()[1]),
            ScriptedPage(),
        )
        try:
            self._gateway.open(opened)
        except PageServerError:
            opened.close()
            self._hidden.close()
            raise
        atexit.register(self.close)

    @property
    def browsers(self) -> int:
        """How many show the page."""
        return self._gateway.browsers

    def close(self) -> None:
        """Close the page; more than once is no mistake."""
        atexit.unregister(self.close)
        self._gateway.close()
        self._hidden.close()


def _check_installed() -> None:
    """Check that what the page is made with can be imported.

    Raises:
        PageServerError: If something is not installed.
    """
    try:
        with uninterrupted():  # scipy, which they import, loses an interrupt
            import trimesh  # noqa: F401
            import viser  # noqa: F401
            import websockets.asyncio.server  # noqa: F401  older ones have none
    except ModuleNotFoundError as error:
        raise PageServerError(missing("the browser view", error)) from None
