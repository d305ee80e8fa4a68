"""Stamps that rise strictly, as TF wants them."""

from __future__ import annotations

INSTANT = 1_000_000
"""A stamp that is less than this behind the last one is of the same instant, in [ns]:
time that goes back goes back further."""


class RisingStamps:
    """Give each state a stamp of its own.

    TF keeps one transform per stamp and frame and refuses a second one. While time
    stands still there may be several states of one instant: they are told a nanosecond
    apart.
    """

    def __init__(self) -> None:
        """Begin without any."""
        self._last: int | None = None

    def next(self, stamp: int) -> tuple[int, bool]:
        """Find the stamp to publish a state under.

        Args:
            stamp: The state's time in [ns]. Zero, which means no time in ROS, becomes
                a nanosecond.

        Returns:
            The stamp in [ns], and whether time went back.
        """
        stamp = max(stamp, 1)
        last, self._last = self._last, stamp
        if last is None or stamp > last:
            return stamp, False
        if last - stamp >= INSTANT:
            return stamp, True
        self._last = last + 1
        return self._last, False

    def again(self) -> int:
        """Find the stamp to publish the last state under once more, in [ns]."""
        self._last = 1 if self._last is None else self._last + 1
        return self._last
