"""A part of the past of a robot, as a page shows it."""

from __future__ import annotations

from dataclasses import dataclass

from g1_description.motion.history import HistoryPart
from g1_description.robot.state import RobotState
from g1_description.web.robot import ShownRobot

SECOND = 1_000_000_000
"""In [ns]."""


@dataclass(eq=False)
class Timeline:
    """A range of time that stays as it is while time goes on. Times are in [ns]."""

    robot: ShownRobot
    run: int | None = None
    """Number of the run; None: the newest, until a state of it is known."""

    end: int | None = None
    """Its right end; None: that of the run, until it is known."""

    left_at: int | None = None
    """When the page left the present, or the end of an earlier run; None: not known."""

    requested: int | None = None
    """The time of the last request; None: there was none, or of no time."""

    state: RobotState | None = None
    """The shown state, once it is known."""

    before: RobotState | None = None
    """One shortly before it, if there is one."""

    is_newest: bool = True
    """Whether there was no later run at the last answer."""

    @classmethod
    def until_now(cls, robot: ShownRobot, stamp: int) -> Timeline:
        """Return the time line that ends at the newest state of a robot."""
        return cls(robot, end=stamp, left_at=stamp, requested=stamp)

    @property
    def ends_live(self) -> bool:
        """Whether its right end is where the page left the present."""
        return self.is_newest and self.end == self.left_at

    def limited(self, stamp: int) -> int:
        """Return a time, or the last one of the time line if that is earlier."""
        return stamp if self.left_at is None else min(stamp, self.left_at)

    def begin(self, length: int) -> int:
        """Return the left end of a time line of a length."""
        return max((self.end or 0) - length, 1)

    def take(self, part: HistoryPart, requested: int | None) -> None:
        """Take the answer to a request: its last state is shown.

        Args:
            part: One or two states.
            requested: The time of the request; a later request stays as it is.
        """
        states = part.stretch.states()
        self.state, self.before = states[-1], states[0] if states[1:] else None
        if self.requested == requested:
            self.requested = self.state.stamp
        self.run = part.stretch.run
        self.is_newest = self.run == part.last_run
        if self.left_at is None:
            self.end = self.left_at = part.last

    def back(self, length: int) -> float:
        """Return where the shown state is, in [s] before the right end.

        A time line of this length that does not have the state is moved: the state is
        in its middle then, or as near to that as the present allows.
        """
        assert self.state is not None and self.end is not None
        at = self.state.stamp
        if not self.end - length <= at <= self.end:
            self.end = self.limited(at + length // 2)
        return round(min(max(1e-9 * (at - self.end), -1e-9 * length), 0.0), 3)

    def title(self, newest: RobotState | None) -> str:
        """Name the shown time, with its run if time has gone back since.

        Args:
            newest: The robot's state now.
        """
        if self.state is None:
            return ""
        is_later = newest is not None and newest.stamp >= (self.left_at or 0)
        run = "" if self.is_newest and is_later else f"run {self.run}, "
        return f"{run}{self.state.time:.3f} s"
