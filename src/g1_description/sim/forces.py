"""Wrenches and efforts that act for a span of simulated time."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from g1_description.sim.drives import MAX_EFFORT
from g1_description.sim.engine import Engine
from g1_description.sim.entities import Entity
from g1_description.sim.model import Model


@dataclass(frozen=True)
class Span:
    """Start and end of a force, in [ns] of simulated time."""

    start: int
    end: int | None
    """None: for ever."""

    def holds(self, time_ns: int) -> bool:
        """Return whether it acts during the step that ends at a time."""
        return self.start < time_ns and (self.end is None or time_ns <= self.end)

    def is_over(self, time_ns: int) -> bool:
        """Return whether it has ended at a time."""
        return self.end is not None and self.end <= time_ns

    def covers(self, other: Span, now: int) -> bool:
        """Return whether another span lies, from now on, within this one."""
        outlasts = self.end is None or (other.end is not None and other.end <= self.end)
        return outlasts and self.start <= max(other.start, now)


class ForceSchedule:
    """Present and future wrenches and efforts, in the order of their requests."""

    def __init__(self, is_dynamic: bool) -> None:
        self._is_dynamic = is_dynamic  # else nothing moves, and nothing is scheduled
        self._wrenches: list[tuple[Entity, Span, np.ndarray]] = []
        self._efforts: dict[tuple[Entity, Span], float] = {}

    def __len__(self) -> int:
        return len(self._wrenches) + len(self._efforts)

    def apply_wrench(
        self, link: Entity, span: Span, wrench: np.ndarray, now: int
    ) -> None:
        """Schedule a wrench on a link. Of several on one link the newest acts.

        As in Gazebo, where a wrench overwrites a link's force.

        Args:
            link: The link.
            span: Start and end.
            wrench: Force at the center of mass in [N] and torque in [N m], along
                the world's axes, shape (6,).
            now: The current time in [ns].
        """
        if not self._is_dynamic:
            return
        self._wrenches = [
            old
            for old in self._wrenches
            if old[0] != link or not span.covers(old[1], now)
        ]
        self._wrenches.append((link, span, wrench))

    def apply_effort(self, joint: Entity, span: Span, effort: float) -> None:
        """Schedule an effort of a joint, within its limit. Several efforts add up.

        Args:
            joint: The joint; a fixed one is ignored.
            span: Start and end.
            effort: Effort in [N m] or [N].
        """
        if not self._is_dynamic or joint.model.joint_row(joint.name) is None:
            return
        limit = min(joint.joint.effort, MAX_EFFORT)
        key = joint, span
        before = self._efforts.get(key, 0.0)
        self._efforts[key] = before + min(max(effort, -limit), limit)

    def clear_wrenches(self, scoped_link: str) -> None:
        """Remove the wrenches on a link, by its scoped name."""
        self._wrenches = [w for w in self._wrenches if w[0].scoped != scoped_link]

    def clear_efforts(self, joint: str) -> None:
        """Remove the efforts of all joints of this plain name."""
        self._efforts = {k: e for k, e in self._efforts.items() if k[0].name != joint}

    def forget(self, model: Model) -> None:
        """Remove the wrenches and efforts of a model."""
        self._wrenches = [w for w in self._wrenches if w[0].model is not model]
        kept = {k: e for k, e in self._efforts.items() if k[0].model is not model}
        self._efforts = kept

    def steady_steps(self, time_ns: int, step_ns: int) -> float:
        """Count the steps after a time that have the same forces.

        Args:
            time_ns: The time in [ns].
            step_ns: Length of a step in [ns].
        """
        spans = [span for _, span, _ in self._wrenches]
        spans += [span for _, span in self._efforts]
        ends = [t for span in spans for t in (span.start, span.end) if t is not None]
        steps = [(end - time_ns) // step_ns for end in ends if end > time_ns]
        return max(1, min(steps, default=math.inf))

    def apply(self, engine: Engine, time_ns: int, end_ns: int) -> None:
        """Apply the forces of the next steps, and remove those that end with them.

        Args:
            engine: The engine of the models.
            time_ns: The time at which the first step ends, in [ns].
            end_ns: The time at which the last step ends, in [ns].
        """
        active = {link: w for link, span, w in self._wrenches if span.holds(time_ns)}
        for link, wrench in active.items():
            engine.apply_wrench(link.model, link.name, wrench)
        for (joint, span), effort in self._efforts.items():
            row = joint.model.joint_row(joint.name)
            if row is not None and span.holds(time_ns):
                engine.apply_effort(joint.model, row, effort)
        if any(span.is_over(end_ns) for _, span, _ in self._wrenches):
            self._wrenches = [w for w in self._wrenches if not w[1].is_over(end_ns)]
        if any(span.is_over(end_ns) for _, span in self._efforts):
            kept = {k: e for k, e in self._efforts.items() if not k[1].is_over(end_ns)}
            self._efforts = kept
