"""A film: moments of robots on ROS' clock, drawn afterwards."""

from __future__ import annotations

import sys
from typing import Callable, Iterator, Sequence

import numpy as np
import rospy
from PIL import Image

from g1_description.core.errors import InvalidValueError
from g1_description.ros.node.waiting import NoAnswerError, wait_until

from .picture_files import in_colors, palette_of
from .robot_watch import Moment, RobotWatch

CLOCK_TIMEOUT = 10.0
"""Longest wait for the clock to go on, in [s]."""

LONGEST, FASTEST = 60.0, 30.0
"""Of a film, in [s] and in pictures per second."""

MAX_PIXELS = 500e6
"""Of all pictures of a film together: they are kept until it is written."""


def count(seconds: float, fps: float) -> int:
    """Return how many pictures a film has."""
    return max(1, round(seconds * fps))


def check_length(seconds: float, fps: float, size: tuple[int, int]) -> None:
    """Check that a film can be made.

    Raises:
        InvalidValueError: If it would be too long, too fast or too large.
    """
    for name, value, most in (("fps", fps, FASTEST), ("seconds", seconds, LONGEST)):
        if not 0.0 < value <= most:
            raise InvalidValueError(
                f"A film cannot have --{name} {value:g}, only more than 0 and at most "
                f"{most:g}."
            )
    pixels = count(seconds, fps) * size[0] * size[1]
    if pixels > MAX_PIXELS:
        raise InvalidValueError(
            f"A film of {count(seconds, fps)} pictures of {size[0]}x{size[1]} has "
            f"{pixels / 1e6:.0f} million pixels; there is room for "
            f"{MAX_PIXELS / 1e6:.0f} million."
        )


def record(
    watches: Sequence[RobotWatch], seconds: float, fps: float
) -> list[list[Moment]]:
    """Watch robots for a while.

    Args:
        watches: The robots.
        seconds: How long, in [s] of ROS' clock.
        fps: Moments per second of ROS' clock.

    Returns:
        What all robots did at each moment.

    Raises:
        NoAnswerError: If the clock stands still.
        ROSInterruptException: If the node is shut down.
    """
    clock, moments = _Stopwatch(), []
    for n in range(count(seconds, fps)):
        clock.wait(n / fps)
        moments.append([watch.now() for watch in watches])
    return moments


class _Stopwatch:
    """Time that passes on ROS' clock, also where a reset puts that back."""

    def __init__(self) -> None:
        """Begin at zero."""
        self._last = rospy.get_time()
        self._passed = 0.0

    def wait(self, time: float) -> None:
        """Wait until a time, in [s], however slow the clock is.

        Raises:
            NoAnswerError: If the clock stands still.
            ROSInterruptException: If the node is shut down.
        """
        while self._passed < time:
            if not wait_until(lambda: rospy.get_time() != self._last, CLOCK_TIMEOUT):
                raise NoAnswerError(
                    f"The clock stood still for {CLOCK_TIMEOUT:g} s at "
                    f"{self._last:g} s."
                )
            now = rospy.get_time()
            self._passed += max(0.0, now - self._last)
            self._last = now


def drawn(n: int, picture: Callable[[int], np.ndarray]) -> Iterator[np.ndarray]:
    """Draw all pictures of a film, and show the progress.

    Args:
        n: How many.
        picture: Draws one of them as uint8, shape (height, width, 3).

    Raises:
        KeyboardInterrupt: If the node was shut down meanwhile.
    """
    for k in range(n):
        if rospy.is_shutdown():
            raise KeyboardInterrupt
        yield picture(k)
        _show_progress(k + 1, n)


def film(n: int, picture: Callable[[int], np.ndarray]) -> list[Image.Image]:
    """Draw all pictures of a film, in the same colours.

    Args:
        n: How many.
        picture: Draws one of them as uint8, shape (height, width, 3).

    Raises:
        KeyboardInterrupt: If the node was shut down meanwhile.
    """
    palette = palette_of([picture(k) for k in {0, n // 2, n - 1}])
    return [in_colors(pixels, palette) for pixels in drawn(n, picture)]


def _show_progress(done: int, n: int) -> None:
    """Show the progress: in one line of a terminal, now and then elsewhere."""
    is_last = done == n
    if sys.stderr.isatty():
        end = "\n" if is_last else ""
        print(f"\rframe {done} of {n}", end=end, file=sys.stderr, flush=True)
    elif is_last or done % 25 == 0:
        print(f"frame {done} of {n}", file=sys.stderr, flush=True)
