"""When a world in which everything stands still may skip its steps."""

from __future__ import annotations

REST_SPEED = 1e-5
"""Greatest speed of a joint or root that counts as standing still, in [m/s] or [rad/s]:
above the noise of the solver in a stack of boxes, far below what can be seen."""

REST_TIME = 0.1
"""How long everything must stand still before the world rests, in [s] of simulated
time: a pendulum that turns round is slower than REST_SPEED for less."""


class RestDetector:
    """Counts for how long everything has stood still."""

    def __init__(self) -> None:
        """Begin awake."""
        self._still_for = 0.0
        self._first_speed = 0.0

    @property
    def is_resting(self) -> bool:
        """Whether steps change nothing until something is written."""
        return self._still_for >= REST_TIME

    def wake(self) -> None:
        """Compute again, and count from zero."""
        self._still_for = 0.0

    def update(self, speed: float, time_step: float) -> None:
        """Count a step that was computed.

        What became faster is about to move, however slow it is, such as a pole that
        begins to topple: then the world does not rest.

        Args:
            speed: Greatest speed after the step, in [m/s] or [rad/s].
            time_step: Length of the step in [s].
        """
        if not speed <= REST_SPEED:  # also where it is NaN
            self.wake()
            return
        if self._still_for == 0.0:
            self._first_speed = speed
        self._still_for += time_step
        if self.is_resting and speed > self._first_speed:
            self.wake()
