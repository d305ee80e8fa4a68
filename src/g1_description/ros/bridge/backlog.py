"""Whether messages have piled up, and are to be passed over until the newest."""

from __future__ import annotations

import math
import time

RELIEF = 0.005
"""Waiting for so long, in [s], takes all but a third off what came without a pause.
rospy hands messages on in batches with a millisecond between them, so no single pause
tells that a pile is at its end."""


class Backlog:
    """Tell from the time between messages whether they come out of a pile.

    A node that stood still finds all that came meanwhile in the system's buffers,
    seconds of states. Taken one by one they would make old states look new, and at
    the rate at which new ones come the pile might never become smaller.
    """

    def __init__(self, most: int) -> None:
        """Begin without any.

        Args:
            most: So many messages in a row are not yet a pile.
        """
        self._most = most
        self._in_a_row = 0.0
        self._ended = 0.0
        self.passed_over = 0
        """Messages that were passed over."""

    def is_old(self) -> bool:
        """Tell of the message that has just come whether to pass it over."""
        waited = time.monotonic() - self._ended
        self._in_a_row = 1.0 + self._in_a_row * math.exp(-waited / RELIEF)
        old = self._in_a_row > self._most
        self.passed_over += old
        return old

    def end(self) -> None:
        """Note that all is done for a message."""
        self._ended = time.monotonic()
