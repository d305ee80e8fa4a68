"""Shows the moments of a motion that a person drags through."""

from __future__ import annotations

import threading

from g1_description.web.desk import Desk
from g1_description.web.robots.robot import Player


class Scrub:
    """Shows the newest of many times, one after the other."""

    def __init__(self, desk: Desk) -> None:
        """Show nothing yet."""
        self._desk = desk
        self._lock = threading.Lock()
        self._wanted: tuple[Player, float] | None = None
        self._is_busy = False

    def to(self, player: Player, at: float) -> None:
        """Show a time soon."""
        with self._lock:
            self._wanted = player, at
            if self._is_busy:
                return
            self._is_busy = True
        self._desk.wait_for(self._show)

    def _show(self) -> None:
        while True:
            with self._lock:
                if self._wanted is None:
                    self._is_busy = False
                    return
                (player, at), self._wanted = self._wanted, None
            try:
                player.show(at)
            except Exception:
                with self._lock:
                    self._wanted, self._is_busy = None, False
                raise
