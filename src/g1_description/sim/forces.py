"""Wrenches and efforts that act for a span of simulated time."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from g1_description.sim.bullet.body import MAX_EFFORT
from g1_description.sim.bullet.engine import Engine
from g1_description.sim.entities import JointEntity, LinkEntity
from g1_description.sim.model import Model


@dataclass(frozen=True)
class Span:
    """From when to when something acts, in [ns] of simulated time."""

    start: int
    end: int | None
    """None: for ever."""

    def holds(self, time_ns: int) -> bool:
        """Return whether it acts during the step that ends at a time."""
        return self.start < time_ns and (self.end is None or time_ns <= self.end)

    def is_over(self, time_ns: int) -> bool:
        """Return whether it acts no more after a time."""
        return self.end is not None and self.end <= time_ns

    def covers(self, other: Span, now: int) -> bool:
        """Return whether another acts, from now on, only while this one does."""
        outlasts = self.end is None or (other.end is not None and other.end <= self.end)
        return outlasts and self.start <= max(other.start, now)


@dataclass(frozen=True)
class Wrench:
    """A wrench on a link, along the world's axes, at its center of mass."""

    link: LinkEntity
    span: Span
    force: np.ndarray
    """In [N], shape (3,)."""

    torque: np.ndarray
    """In [N m], shape (3,)."""


@dataclass(frozen=True)
class Effort:
    """An effort of a movable joint."""

    joint: JointEntity
    span: Span
    effort: float
    """In [N m] or [N]."""


class ForceSchedule:
    """What acts and will act, in the order in which it was requested."""

    def __init__(self, is_dynamic: bool) -> None:
        """Begin with nothing.

        Args:
            is_dynamic: Whether things move; where not, nothing is scheduled.
        """
        self._is_dynamic = is_dynamic
        self._wrenches: list[Wrench] = []
        self._efforts: list[Effort] = []

    def __len__(self) -> int:
        """Count what acts and will act."""
        return len(self._wrenches) + len(self._efforts)

    def apply_wrench(
        self, link: LinkEntity, span: Span, wrench: np.ndarray, now: int
    ) -> None:
        """Schedule a wrench on a link. Of several on one link only the newest acts.

        Gazebo sets a link's force again with each of its wrenches. Those that the new
        one leaves no time for are removed.

        Args:
            link: The link.
            span: From when to when.
            wrench: Force at the center of mass in [N] and torque in [N m], along
                the world's axes, shape (6,).
            now: The time in [ns].
        """
        if not self._is_dynamic:
            return
        self._wrenches = [
            old
            for old in self._wrenches
            if old.link != link or not span.covers(old.span, now)
        ]
        self._wrenches.append(Wrench(link, span, *wrench.reshape(2, 3)))

    def apply_effort(self, joint: JointEntity, span: Span, effort: float) -> None:
        """Schedule an effort of a joint, within its limit. Several of one add up.

        Args:
            joint: The joint; a fixed one bears any effort.
            span: From when to when.
            effort: In [N m] or [N].
        """
        if not self._is_dynamic or joint.row is None:
            return
        limit = min(joint.joint.effort, MAX_EFFORT)
        new = Effort(joint, span, min(max(effort, -limit), limit))
        for old in self._efforts:
            if (old.joint, old.span) == (joint, span):
                self._efforts.remove(old)
                new = replace(new, effort=new.effort + old.effort)
                break
        self._efforts.append(new)

    def clear_wrenches(self, scoped_link: str) -> None:
        """Remove the wrenches on a link, by its scoped name."""
        self._wrenches = [w for w in self._wrenches if w.link.scoped != scoped_link]

    def clear_efforts(self, joint: str) -> None:
        """Remove the efforts of all joints of this plain name."""
        self._efforts = [e for e in self._efforts if e.joint.name != joint]

    def forget(self, model: Model) -> None:
        """Remove what acts on a model."""
        self._wrenches = [w for w in self._wrenches if w.link.model is not model]
        self._efforts = [e for e in self._efforts if e.joint.model is not model]

    def apply(self, engine: Engine, time_ns: int) -> None:
        """Apply what acts during the next step, and remove what is over then.

        Args:
            engine: What moves the models.
            time_ns: The time at which the step ends, in [ns].
        """
        active = [w for w in self._wrenches if w.span.holds(time_ns)]
        for wrench in {w.link: w for w in active}.values():
            for body in engine.bodies(wrench.link.model):
                if body.has_link(wrench.link.name):
                    body.apply_wrench(wrench.link.name, wrench.force, wrench.torque)
        for effort in self._efforts:
            if effort.span.holds(time_ns):
                for body in engine.bodies(effort.joint.model):
                    if effort.joint.name in body.joints:
                        body.joints.apply_effort(effort.joint.name, effort.effort)
        if any(w.span.is_over(time_ns) for w in self._wrenches):
            self._wrenches = [w for w in self._wrenches if not w.span.is_over(time_ns)]
        if any(e.span.is_over(time_ns) for e in self._efforts):
            self._efforts = [e for e in self._efforts if not e.span.is_over(time_ns)]
