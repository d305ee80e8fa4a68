"""Values that people edit, which the page must not overwrite meanwhile."""

from __future__ import annotations

import math
import time
from typing import Any

import numpy as np

HELD = 0.7
"""Time for which an edited element does not follow the robot, in [s]: states that
arrive meanwhile are older."""

ROUND_TRIP = 0.3
"""Longest time in [s] in which an update and an edit may cross on their ways."""


class Edits:
    """Distinguishes values that a person has set from those of the page.

    An element's ``update_timestamp`` is that of its last change, whoever made it.
    """

    def __init__(self) -> None:
        self._shown: dict[int, float] = {}
        """When the page last set a value, by identity of the element."""

    def is_held(self, handle: Any) -> bool:
        """Return whether an element was edited recently."""
        edited = handle.update_timestamp
        is_edited = edited != self._shown.get(id(handle))
        return is_edited and abs(time.time() - edited) < HELD

    def show(self, handle: Any, value: Any, tolerance: float = 0.0) -> None:
        """Show a value, if it differs and nobody edits it.

        A browser that sent a value may receive an older one afterwards, so an element
        that was edited just after an update is updated in any case. No other is, as
        that would undo what is being typed.

        Args:
            handle: The element.
            value: A number, several, or a text.
            tolerance: Smaller differences of numbers are ignored.
        """
        if self.is_held(handle):
            return
        key, edited = id(handle), handle.update_timestamp
        shown = self._shown.get(key, -math.inf)
        has_crossed = shown < edited < shown + ROUND_TRIP
        if _is_near(handle.value, value, tolerance):
            if not has_crossed or isinstance(value, str):
                return
            handle.value = np.add(value, 1.0)  # viser sends only changed values
        handle.value = value
        self._shown[key] = handle.update_timestamp


def _is_near(one: Any, other: Any, tolerance: float) -> bool:
    """Compare two values, whose numbers may differ a little."""
    if isinstance(other, str) or np.shape(one) != np.shape(other):
        return bool(one == other)
    return bool(np.abs(np.subtract(one, other)).max() <= tolerance)
