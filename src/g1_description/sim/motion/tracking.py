"""How well the motors of a model follow a motion, watched step by step."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from g1_description.core.motion.playlist import Playback, Setpoint
from g1_description.core.motion.tracking import (
    FallDetector,
    FallLimits,
    TrackingRecorder,
    TrackingReport,
)
from g1_description.sim.bullet.engine import Engine
from g1_description.sim.model import Model

WATCH_TIME = 1_000_000_000
"""How long a robot is watched after a motion, in [ns]: so long it takes to fall."""


class TrackedMotion(NamedTuple):
    """A motion that is over, and what became of it."""

    model_name: str

    start_ns: int
    """When its times counted from, in [ns] of simulated time."""

    report: TrackingReport


class MotionTracker:
    """Watches one motion of a model, and its base for ``WATCH_TIME`` after the end."""

    def __init__(
        self,
        engine: Engine,
        model: Model,
        playback: Playback,
        fall_limits: FallLimits | None = None,
    ) -> None:
        """Begin before the first step of the motion.

        Args:
            engine: What computes the steps.
            model: Whose motors follow.
            playback: The motion.
            fall_limits: From where on its base has fallen.
        """
        self._engine, self.model = engine, model
        self._start_ns = playback.start_ns
        names = [model.joint_names[row] for row in playback.rows]
        self._recorder = TrackingRecorder(tuple(names))
        self._columns = np.zeros(len(model.joint_names), dtype=int)
        self._columns[playback.rows] = np.arange(len(names))
        self._fall_limits = fall_limits
        self._falls: FallDetector | None = None
        self._fall_ns: int | None = None
        self._wanted: Setpoint | None = None
        self._base: np.ndarray | None = None
        self._end_ns = 0

    def expect(self, wanted: Setpoint) -> None:
        """Note what the motors are to reach in the next step."""
        if self._falls is None:
            self._falls = FallDetector(
                self.model.root_poses[0], wanted.base_pose, self._fall_limits
            )
        self._wanted = wanted

    def measure(self, time_ns: int) -> bool:
        """Compare the model with what was expected; return whether to go on.

        Without anything expected the motion is over, and only the base is watched.

        Args:
            time_ns: Time of the model's state in [ns].
        """
        if self._wanted is not None:
            self._end_ns, self._base = time_ns, self._wanted.base_pose
            self._record(time_ns, self._wanted)
            self._wanted = None
        self._watch_base(time_ns)
        return time_ns < self._end_ns + WATCH_TIME

    def _record(self, time_ns: int, wanted: Setpoint) -> None:
        """Record the joints of a step."""
        self._recorder.add(
            1e-9 * (time_ns - self._start_ns),
            self._columns[wanted.rows],
            self.model.position[wanted.rows] - wanted.positions,
            self._engine.at_effort_limit(self.model)[wanted.rows],
        )

    def _watch_base(self, time_ns: int) -> None:
        """Note when the base has fallen; one that is fixed does not."""
        if self._fall_ns is not None or self.model.trees[0].fixed:
            return
        if self._falls and self._falls.has_fallen(self.model.root_poses[0], self._base):
            self._fall_ns = time_ns

    @property
    def has_fallen(self) -> bool:
        """Whether the base has fallen until now."""
        return self._fall_ns is not None

    def tracked(self) -> TrackedMotion:
        """Return what has become of the motion until now."""
        fall = None
        if self._fall_ns is not None:
            fall = 1e-9 * (self._fall_ns - self._start_ns)
        report = self._recorder.report(fall)
        return TrackedMotion(self.model.name, self._start_ns, report)
