"""Names of the links that people point at, each for one person only."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Any

from .robot import SceneRobot

if TYPE_CHECKING:
    from viser import LabelHandle, ViserServer

KEYS = "cmd/ctrl+alt+shift"
"""Viser tells of clicks only. The page's script lets a mouse that rests click with
these keys, which nobody holds together."""

SHOWN = 3.0
"""How long a name stays where the mouse rests, in [s]."""


class Pointer:
    """Shows a name to each person who points at a link."""

    def __init__(self, server: ViserServer) -> None:
        """Show none."""
        self._server = server
        self._shown: dict[int, tuple[LabelHandle, float]] = {}

    def show(self, body: SceneRobot, link: str, client: Any) -> None:
        """Show the name of a link to one person, instead of the one before."""
        self._hide(client.client_id)
        if client.client_id not in self._server.get_clients():
            return
        until = time.monotonic() + SHOWN
        self._shown[client.client_id] = body.point_at(link, client), until

    def tick(self) -> None:
        """Hide the names that were shown for long enough."""
        now = time.monotonic()
        for number in [n for n, (_, until) in self._shown.items() if until < now]:
            self._hide(number)

    def _hide(self, number: int) -> None:
        label, _ = self._shown.pop(number, (None, 0.0))
        if label is not None and number in self._server.get_clients():
            label.remove()
