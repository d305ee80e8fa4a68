"""Wrenches and efforts that act for a span of simulated time."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from .engine import Engine
from .model import Model


@dataclass(frozen=True)
class Span:
    """From when to when something acts, in [ns] of simulated time."""

    start: int
    end: int | None
    """None: for ever."""

    def holds(self, time_ns: int) -> bool:
        """Tell whether it acts during the step that ends at a time."""
        return self.start < time_ns and (self.end is None or time_ns <= self.end)

    def is_over(self, time_ns: int) -> bool:
        """Tell whether it acts no more after a time."""
        return self.end is not None and self.end <= time_ns


@dataclass(frozen=True)
class Wrench:
    """A wrench on a link, along the world's axes, at its center of mass."""

    model: Model
    link: str
    span: Span
    force: np.ndarray
    """In [N], shape (3,)."""

    torque: np.ndarray
    """In [N m], shape (3,)."""


@dataclass(frozen=True)
class Effort:
    """An effort of a joint; a fixed joint bears any."""

    model: Model
    joint: str
    span: Span
    effort: float
    """In [N m] or [N]."""


class Jobs:
    """What acts and will act, in the order it was asked for."""

    def __init__(self) -> None:
        """Begin with nothing."""
        self._jobs: list[Wrench | Effort] = []

    def add(self, job: Wrench | Effort) -> None:
        """Plan a job."""
        self._jobs.append(job)

    def drop(self, unwanted: Callable[[Wrench | Effort], bool]) -> None:
        """Forget all jobs that are not wanted any more."""
        self._jobs = [job for job in self._jobs if not unwanted(job)]

    def act(self, engine: Engine, time_ns: int) -> None:
        """Let everything act during the next step, and forget what is over then.

        Of several wrenches on a link the newest alone acts, as Gazebo sets a
        link's force; efforts of a joint add up.

        Args:
            engine: What moves the models.
            time_ns: The time at which the step ends, in [ns].
        """
        if not self._jobs:
            return
        active = [job for job in self._jobs if job.span.holds(time_ns)]
        wrenches = [job for job in active if isinstance(job, Wrench)]
        for job in {(job.model.name, job.link): job for job in wrenches}.values():
            engine.push(job.model, job.link, job.force, job.torque)
        for effort in active:
            if isinstance(effort, Effort):
                engine.strain(effort.model, effort.joint, effort.effort)
        self.drop(lambda job: job.span.is_over(time_ns))
