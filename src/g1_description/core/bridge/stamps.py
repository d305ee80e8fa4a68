"""Stamps that rise strictly, as TF wants them."""

from __future__ import annotations

INSTANT = 100_000
"""A stamp that is less than this behind the last one is of the same instant, in [ns]:
time goes back by a step at least, and nobody shows so many states of one instant."""


class RisingStamps:
    """Give each state a stamp of its own.

    TF keeps one transform per stamp and frame and refuses a second one. While time
    stands still there may be several states of one instant: they are told a nanosecond
    apart.
    """

    def __init__(self) -> None:
        """Begin without any."""
        self.last = 0
        """The last one in [ns]; 0 before the first."""

    def next(self, stamp: int) -> tuple[int, bool]:
        """Find the stamp to publish a state under.

        Args:
            stamp: The state's time in [ns]. Zero, which means no time in ROS, becomes
                a nanosecond.

        Returns:
            The stamp in [ns], and whether time went back.
        """
        stamp = max(stamp, 1)
        went_back = stamp <= self.last - INSTANT
        if not went_back:
            stamp = max(stamp, self.last + 1)
        self.last = stamp
        return stamp, went_back

    def again(self) -> int:
        """Find the stamp to publish the last state under once more, in [ns]."""
        self.last += 1
        return self.last
