"""Spans of simulated time from a request."""

from __future__ import annotations

from g1_description.sim.forces import Span


def span_of(start_time, duration, now_ns: int) -> Span:
    """Tell from when to when something acts, as Gazebo takes it.

    Args:
        start_time: When it shall begin; the past means now.
        duration: How long it shall act; negative means for ever.
        now_ns: The time now, in [ns].

    Returns:
        The span.
    """
    start = max(start_time.to_nsec(), now_ns)
    lasting = duration.to_nsec()
    return Span(start, None if lasting < 0 else start + lasting)
