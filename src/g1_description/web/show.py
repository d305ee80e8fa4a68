"""A world of robots on a page, until somebody ends it."""

from __future__ import annotations

from collections.abc import Callable

from g1_description.web.check_thread import MakeChecker
from g1_description.web.library import Library
from g1_description.web.page import Page
from g1_description.web.robot import ShownWorld
from g1_description.web.server.address import ServerOptions
from g1_description.web.server.page_server import PageServer


class Show:
    """A page and its server."""

    def __init__(
        self,
        world: ShownWorld,
        options: ServerOptions,
        make_checker: MakeChecker,
        library: Library | None = None,
        motion_first: bool = False,
    ) -> None:
        """Open the page.

        Args:
            world: The robots.
            options: Who may come in, and where.
            make_checker: Prepares the checks of a robot.
            library: Motions to look through; None: none.
            motion_first: Whether the page opens with the tab of the motion.

        Raises:
            PageServerError: If the page cannot be opened.
        """
        self._server = PageServer(options)
        self.page = Page(
            self._server.viser,
            world,
            make_checker,
            options.read_only,
            library,
            motion_first,
        )
        self.page.watched = lambda: self._server.browsers

    @property
    def address(self) -> str:
        """URL of the page."""
        return self._server.address

    def run(self) -> None:
        """Draw until ``stop`` is called."""
        try:
            self.page.run()
        finally:
            self._server.close()

    def stop(self) -> None:
        """End ``run``; from any thread, and from a signal."""
        self.page.stop()


def report_address(
    show: Show, options: ServerOptions, report: Callable[[str], object]
) -> None:
    """Report the address, and the effect of a token in it."""
    report(f"open {show.address}")
    if "token=" in show.address:
        may = "sees" if options.read_only else "moves"
        report(f"Anyone with this address {may} the robot.")
