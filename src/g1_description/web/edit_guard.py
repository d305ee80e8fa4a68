"""Elements of the page that show where something is, and that a person may move."""

from __future__ import annotations

import time
from typing import Any

import numpy as np


class Held:
    """Lets elements stay for a while where a person has put them.

    A person's value comes by a thread of viser's, and the thread that draws is told of
    it later. Until then, it must not show an older one in its place.
    """

    def __init__(self, seconds: float) -> None:
        """Hold nothing.

        Args:
            seconds: How long an element stays, in [s].
        """
        self._seconds = seconds
        self._seen: dict[int, Any] = {}
        self._until: dict[int, float] = {}

    def know(self, handle: Any) -> None:
        """Take the present value of an element for one of ours."""
        self._seen[id(handle)] = handle.value

    def hold(self, handle: Any) -> None:
        """Let an element stay as it is."""
        self._seen[id(handle)] = handle.value
        self._until[id(handle)] = time.monotonic() + self._seconds

    def is_held(self, handle: Any) -> bool:
        """Tell whether an element stays, also because a person has just moved it."""
        # The same object, as a value that is no number is not equal to itself.
        if handle.value is not self._seen.get(id(handle)):
            self.hold(handle)
        return time.monotonic() < self._until.get(id(handle), 0.0)

    def show(self, handle: Any, value: Any, tolerance: float = 0.0) -> None:
        """Show a value, if it is another one.

        A browser that sends a value does not hear of it, but may still get the one
        before. So what was held is shown again in any case.

        Args:
            handle: The element.
            value: A number, or some.
            tolerance: By how much it may be another one.
        """
        was_held = self._until.pop(id(handle), None) is not None
        is_same = np.shape(handle.value) == np.shape(value) and (
            np.abs(np.subtract(handle.value, value)).max() <= tolerance
        )
        if is_same and was_held:
            handle.value = np.add(value, 1.0)  # as viser sends only what changes
        if was_held or not is_same:
            handle.value = value
            self._seen[id(handle)] = handle.value

    def let_go(self) -> None:
        """Hold nothing any more."""
        self._until = dict.fromkeys(self._until, 0.0)
