"""Stamps that rise strictly, as TF requires."""

from __future__ import annotations

MAX_STEP_BACK = 100_000
"""A stamp less than this far behind the last one, in [ns], is of the same instant.
A reset goes back by at least a time step, and no simulator publishes so many states of
one instant that their stamps reach this far."""

MAX_CLOCK_LAG = 100_000_000
"""A clock further behind the last state, in [ns], was reset; the bridge may have the
state sooner than the clock."""

MAX_CLOCK_LEAD = 10 * MAX_CLOCK_LAG
"""After a reset, a state further ahead of the clock, in [ns], is from before it."""


class RisingStamps:
    """Gives each state a stamp of its own.

    TF keeps one transform per stamp and frame and refuses a second one. While time
    stands still there may be several states of one instant: their stamps are a
    nanosecond apart.
    """

    def __init__(self) -> None:
        """Begin without a stamp."""
        self.last = 0
        """The last stamp in [ns]; 0 before the first."""
        self._now = 0
        self._was_reset = False

    def next(self, stamp: int, now: int) -> tuple[int, bool] | None:
        """Compute the stamp to publish a state under.

        Args:
            stamp: The state's time in [ns]. Zero, which means no time in ROS, becomes
                a nanosecond.
            now: Time on the clock in [ns].

        Returns:
            The stamp in [ns], and whether time went back. None for a state from before
            a reset that arrives after it: listeners must not have it.
        """
        self._was_reset |= now < self._now - MAX_CLOCK_LAG
        self._now = now
        if self._was_reset and stamp > now + MAX_CLOCK_LEAD:
            return None
        self._was_reset = False
        stamp = max(stamp, 1)
        went_back = stamp <= self.last - MAX_STEP_BACK
        if not went_back:
            stamp = max(stamp, self.last + 1)
        self.last = stamp
        return stamp, went_back

    def is_ahead_of(self, now: int) -> bool:
        """Whether a clock in [ns] was reset since the last stamp."""
        return now < self.last - MAX_CLOCK_LAG

    def again(self) -> int:
        """Compute the stamp to publish the last state under once more, in [ns]."""
        self.last += 1
        return self.last
