"""Wrenches and efforts that act for a span of simulated time."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from g1_description.core.robot.assembly import SCOPE
from g1_description.sim.bullet.body import NO_LIMIT
from g1_description.sim.bullet.engine import Engine

from .entities import Entity
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

    def covers(self, other: Span, now: int) -> bool:
        """Tell whether another acts, from now on, only while this one does."""
        outlasts = self.end is None or (other.end is not None and other.end <= self.end)
        return outlasts and self.start <= max(other.start, now)


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
    """An effort of a movable joint."""

    model: Model
    joint: str
    span: Span
    effort: float
    """In [N m] or [N]."""


class Jobs:
    """What acts and will act, in the order it was asked for."""

    def __init__(self, is_dynamic: bool) -> None:
        """Begin with nothing.

        Args:
            is_dynamic: Whether things move; where not, nothing is planned.
        """
        self._is_dynamic = is_dynamic
        self._wrenches: list[Wrench] = []
        self._efforts: list[Effort] = []

    def __len__(self) -> int:
        """Count what acts and will act."""
        return len(self._wrenches) + len(self._efforts)

    def push(self, entity: Entity, span: Span, wrench: np.ndarray, now: int) -> None:
        """Plan a wrench on a link. Where several act the newest alone does.

        Gazebo sets a link's force anew with each of its jobs. What the new one
        leaves no time for is forgotten.

        Args:
            entity: The link.
            span: From when to when.
            wrench: Force at the center of mass in [N] and torque in [N m], along
                the world's axes, shape (6,).
            now: The time in [ns].
        """
        if not self._is_dynamic:
            return
        assert entity.model is not None
        new = Wrench(entity.model, entity.name, span, *wrench.reshape(2, 3))
        self._wrenches = [
            old
            for old in self._wrenches
            if (old.model, old.link) != (new.model, new.link)
            or not span.covers(old.span, now)
        ]
        self._wrenches.append(new)

    def strain(self, entity: Entity, span: Span, effort: float) -> None:
        """Plan an effort of a joint, within its limit. Where several act, they add up.

        Args:
            entity: The joint; a fixed one bears any effort.
            span: From when to when.
            effort: In [N m] or [N].
        """
        if not self._is_dynamic or entity.row < 0:
            return
        assert entity.model is not None
        limit = min(entity.joint.effort, NO_LIMIT)
        bounded = min(max(effort, -limit), limit)
        new = Effort(entity.model, entity.name, span, bounded)
        for old in self._efforts:
            if (old.model, old.joint, old.span) == (new.model, new.joint, span):
                self._efforts.remove(old)
                new = replace(new, effort=bounded + old.effort)
                break
        self._efforts.append(new)

    def clear_wrenches(self, scoped_link: str) -> None:
        """Forget the wrenches on a link, by its scoped name."""
        self._wrenches = [
            job
            for job in self._wrenches
            if f"{job.model.name}{SCOPE}{job.link}" != scoped_link
        ]

    def clear_efforts(self, joint: str) -> None:
        """Forget the efforts of all joints of this plain name."""
        self._efforts = [job for job in self._efforts if job.joint != joint]

    def forget(self, model: Model) -> None:
        """Forget what acts on a model."""
        self._wrenches = [job for job in self._wrenches if job.model is not model]
        self._efforts = [job for job in self._efforts if job.model is not model]

    def act(self, engine: Engine, time_ns: int) -> None:
        """Let everything act during the next step, and forget what is over then.

        Args:
            engine: What moves the models.
            time_ns: The time at which the step ends, in [ns].
        """
        active = [job for job in self._wrenches if job.span.holds(time_ns)]
        for job in {(job.model.name, job.link): job for job in active}.values():
            engine.push(job.model, job.link, job.force, job.torque)
        for effort in self._efforts:
            if effort.span.holds(time_ns):
                engine.strain(effort.model, effort.joint, effort.effort)
        if any(job.span.is_over(time_ns) for job in self._wrenches):
            self._wrenches = [j for j in self._wrenches if not j.span.is_over(time_ns)]
        if any(job.span.is_over(time_ns) for job in self._efforts):
            self._efforts = [j for j in self._efforts if not j.span.is_over(time_ns)]
