"""Motions that models play step by step, and their tracking by motors."""

from __future__ import annotations

import math
from collections.abc import Collection

import numpy as np

from g1_description.errors import InvalidValueError, UnknownNameError
from g1_description.motion.motion import Motion
from g1_description.motion.playlist import Playback, Playlist, Setpoint
from g1_description.motion.tracking import (
    FallDetector,
    FallLimits,
    TrackingRecorder,
    TrackingReport,
)
from g1_description.sim.anchor import Anchors
from g1_description.sim.engine import Engine, Steps
from g1_description.sim.model import Model, Report

WATCH_TIME = 1_000_000_000
"""Time for which a robot is observed after a motion, in [ns]: as long as a fall."""

FULL_EFFORT = 0.999
"""Fraction of the effort limit above which a motor is saturated: engines round."""


class MotionTracker:
    """Compares a model with one motion, and its base for ``WATCH_TIME`` after it.

    Joints are compared up to a fall: a robot on the floor follows no motion.
    """

    def __init__(
        self,
        engine: Engine,
        model: Model,
        playback: Playback,
        fall_limits: FallLimits | None = None,
    ) -> None:
        self._engine, self.model = engine, model
        self.start_ns = playback.start_ns
        """Start of the motion's times, in [ns] of simulated time."""
        limits = FULL_EFFORT * engine.effort_limits(model)
        self._limits = np.where(limits > 0.0, limits, np.inf)
        names = [model.joint_names[row] for row in playback.rows]
        self._recorder = TrackingRecorder(tuple(names))
        self._columns = np.zeros(len(model.joint_names), dtype=int)
        self._columns[playback.rows] = np.arange(len(names))
        self._fall_limits = fall_limits
        self._falls: FallDetector | None = None
        self._fall_time: float | None = None
        self._desired: Setpoint | None = None
        self._base: np.ndarray | None = None
        self._end_ns = 0

    def expect(self, desired: Setpoint) -> None:
        """Record the motors' targets of the next steps, one row each."""
        if self._falls is None:
            base = None if desired.base_pose is None else desired.base_pose[0]
            self._falls = FallDetector(
                self.model.root_poses[0], base, self._fall_limits
            )
        self._desired = desired

    def measure(self, times_ns: np.ndarray, steps: Steps) -> bool:
        """Compare the model with the targets; return whether to continue.

        Without targets the motion is over, and only the base is observed.

        Args:
            times_ns: Times of the states in [ns], shape (n,).
            steps: The model after and in these steps.
        """
        desired, base = self._desired, self._base
        if desired is not None:
            base = desired.base_pose
            self._end_ns = int(times_ns[-1])
            self._base = None if base is None else base[-1]
        until_ns, had_fallen = self._end_ns + WATCH_TIME, self.has_fallen
        count = len(times_ns)
        if self._falls and not (had_fallen or self.model.trees[0].fixed):
            fallen = self._falls.has_fallen(steps.base_poses, base)
            fallen &= times_ns <= until_ns
            if fallen.any():
                count = int(fallen.argmax()) + 1
                self._fall_time = 1e-9 * (int(times_ns[count - 1]) - self.start_ns)
        if desired is not None and not had_fallen:
            rows = desired.rows
            self._recorder.add(
                1e-9 * (times_ns[:count] - self.start_ns),
                self._columns[rows],
                (steps.positions[:, rows] - desired.positions)[:count],
                (np.abs(steps.efforts[:, rows]) >= self._limits[rows])[:count],
            )
        self._desired = None
        return bool(times_ns[-1] < until_ns)

    @property
    def has_fallen(self) -> bool:
        """Whether the base has fallen."""
        return self._fall_time is not None

    @property
    def report(self) -> TrackingReport:
        """Tracking of the motion by the motors so far."""
        return self._recorder.report(self._fall_time)


LIMIT_TOLERANCE = 1e-3
"""Deviation beyond a joint's limits that is not clamped, in [rad] or [m]: files round
positions and limits."""


class Motions:
    """The motions of all models.

    In ``kinematic`` physics they set joints and base at each step; in ``hold`` they set
    the motors' targets and are tracked, and physics moves the base. Motions of joints
    alone move the base of a model that has an anchor.
    """

    def __init__(
        self,
        engine: Engine,
        anchors: Anchors,
        fall_limits: FallLimits | None = None,
    ) -> None:
        self._engine, self._anchors = engine, anchors
        self.fall_limits = fall_limits
        """Definition of a fall, for motions that start from now on."""
        self._playlists: dict[Model, Playlist] = {}
        self._reached: set[Model] = set()
        self._is_shown = False
        self._trackers: dict[Playback, MotionTracker] = {}
        self._tracked: list[MotionTracker] = []

    def __bool__(self) -> bool:
        return bool(self._playlists)

    def play(self, model: Model, motion: Motion, start_ns: int) -> Report:
        """Play a motion, from the first step at or after its start.

        Args:
            model: The model.
            motion: The motion; joints that the model does not have are ignored.
            start_ns: Start of its times, in [ns] of simulated time.

        Returns:
            The ignored joints, and those beyond their limits.

        Raises:
            InvalidValueError: If the model cannot play any part of it.
        """
        has_base = motion.base_poses is not None
        if self._engine.physics == "limp":
            raise InvalidValueError("nothing drives the joints in limp physics")
        if has_base and (not model.trees or model.trees[0].is_on_world):
            raise InvalidValueError(f"the base of {model.name} is fixed to the world")
        is_moved = has_base and not self._engine.is_dynamic
        if not (is_moved or model.joint_rows(motion.joint_names)):
            raise InvalidValueError(f"the motion has no joint of {model.name}")
        playlist = self._playlists.setdefault(model, Playlist(model.joint_names))
        playlist.add(motion, start_ns)
        return _report(model, motion)

    def stop(self, model: Model, names: Collection[str] = ()) -> None:
        """Stop joints, or all of a model.

        Args:
            model: The model.
            names: Names of joints; empty: all of them, and the base.

        Raises:
            UnknownNameError: If it has no such joint; nothing is stopped.
        """
        unknown = [name for name in names if model.joint_row(name) is None]
        if unknown:
            raise UnknownNameError(
                f"{model.name} has no movable joint {', '.join(unknown)}"
            )
        rows = model.joint_rows(names or model.joint_names)
        moved_base = self.moves_base(model)
        playlist = self._playlists.get(model)
        for playback in playlist.moving() if playlist else ():
            stopped = np.intersect1d(playback.rows, np.array(rows, dtype=int))
            base = playback.moves_base and not names
            still = model.target[np.newaxis, stopped], np.zeros((1, len(stopped)))
            root = (model.root_poses[:1], np.zeros((1, 6))) if base else ()
            self._set(model, Setpoint(stopped, *still, *root))
        if not names and self._engine.is_dynamic:
            model.commanded_base = None  # nothing holds the base
        self.release(model, rows, base=not names)
        self._settle(model, moved_base)

    def moves_base(self, model: Model) -> bool:
        """Return whether a motion moves the base of a model now."""
        playlist = self._playlists.get(model)
        return any(one.moves_base for one in playlist.moving()) if playlist else False

    def _settle(self, model: Model, moved_base: bool) -> None:
        """Let the base follow an anchor, or keep the anchor where a path ended."""
        if not moved_base:
            self._anchors.hold(model)
        elif not self.moves_base(model):
            self._anchors.renew(model)

    def release(
        self, model: Model, rows: Collection[int] = (), base: bool = False
    ) -> None:
        """End the motions of movable joints, given by their rows, and of the base."""
        if model in self._playlists:
            self._playlists[model].release(rows, base)

    def forget(self, model: Model) -> None:
        """End all motions of a model; motors hold their last targets."""
        playlist = self._playlists.pop(model, None)
        if playlist:
            self._engine.hold(model, range(len(model.joint_names)))
        kept = [item for item in self._trackers.items() if item[1].model is not model]
        self._trackers = dict(kept)

    def steady_steps(self, time_ns: int) -> float:
        """Count the steps after a time in [ns] that can be computed together.

        No motion begins or ends between them.
        """
        step_ns = self._engine.properties.step_ns
        steps = [p.steady_steps(time_ns, step_ns) for p in self._playlists.values()]
        return min(steps, default=math.inf)

    def step(self, time_ns: int, count: int = 1) -> None:
        """Set models, or their motors' targets, to their motions.

        Args:
            time_ns: Time of the first step in [ns].
            count: Number of steps, at most ``steady_steps``. In ``kinematic`` physics
                the last one applies.
        """
        if self._is_shown:
            self._reached.clear()
            self._is_shown = False
        if not self._playlists:
            return
        step_ns = self._engine.properties.step_ns
        end_ns = time_ns + step_ns * (count - 1)
        first_ns = time_ns
        if not self._engine.is_dynamic:
            first_ns, count = end_ns, 1
        for model, playlist in [*self._playlists.items()]:
            if playlist.is_waiting:
                playlist.begin(time_ns, _state(model))
            moving, moved_base = playlist.moving(), self.moves_base(model)
            for playback in moving:
                found = playback.setpoints(first_ns, step_ns, count)
                desired = self._set(model, found)
                if playback.reaches_sample(end_ns):
                    self._reached.add(model)
                if self._engine.is_dynamic and not playback.is_single:
                    if playback not in self._trackers:
                        self._trackers[playback] = MotionTracker(
                            self._engine, model, playback, self.fall_limits
                        )
                    self._trackers[playback].expect(desired)
            playlist.drop_over(end_ns)
            if moving:
                self._settle(model, moved_base)
            if not playlist:
                del self._playlists[model]

    def has_reached_sample(self, model: Model) -> bool:
        """Return whether a model reached a sample since ``show``, or at its time."""
        return model in self._reached

    def show(self) -> None:
        """Record that the present state is published."""
        self._is_shown = True

    def measure(self, time_ns: int, count: int) -> None:
        """Compare the models with their motions after steps, as of ``step``."""
        if not self._trackers:
            return
        times_ns = time_ns + self._engine.properties.step_ns * np.arange(count)
        for playback, tracker in [*self._trackers.items()]:
            steps = self._engine.last_steps(tracker.model, count)
            if not tracker.measure(times_ns, steps):
                self._tracked.append(tracker)
                del self._trackers[playback]

    def tracker(self, model: Model) -> MotionTracker | None:
        """Return the tracker of a model's newest motion, None without one."""
        own = [one for one in self._trackers.values() if one.model is model]
        return own[-1] if own else None

    def take_tracked(self) -> list[MotionTracker]:
        """Return the trackers of motions that ended since the last call.

        Single configurations are not tracked. A replaced motion is tracked until then.
        """
        tracked, self._tracked = self._tracked, []
        return tracked

    def _set(self, model: Model, desired: Setpoint) -> Setpoint:
        """Set a model or its motors' targets; return them.

        Each row of the arrays is a step. Joints too far beyond their limits are
        clamped, and stopped.
        """
        rows, positions, velocities, *base = desired
        model.commanded[rows] = positions[-1]
        if base[0] is not None:
            model.commanded_base = base[0][-1]
        lower = model.lower[rows] - LIMIT_TOLERANCE
        upper = model.upper[rows] + LIMIT_TOLERANCE
        inside = np.minimum(np.maximum(positions, lower), upper)
        velocities = np.where(inside == positions, velocities, 0.0)
        desired = Setpoint(rows, inside, velocities, *base)
        if self._engine.is_dynamic:
            model.target[rows] = inside[-1]
            self._engine.follow(model, rows, inside, velocities)
        else:
            model.set_moving(desired.at(-1))
            self._engine.write(model)
        return desired


def _state(model: Model) -> Setpoint:
    """Return the state of a model, its joints at the targets of their motors."""
    rows = np.arange(len(model.joint_names))
    base = (model.root_poses[0], model.root_twists[0]) if model.trees else ()
    return Setpoint(rows, model.target, model.velocity, *base)


def _report(model: Model, motion: Motion) -> Report:
    """Find the joints of a motion that a model does not have or has to clamp."""
    report = Report()
    for column, name in enumerate(motion.joint_names):
        row = model.joint_row(name)
        if row is None:
            report.unknown.append(name)
            continue
        lower, upper = float(model.lower[row]), float(model.upper[row])
        positions = motion.positions[:, column]
        most, least = float(positions.max()), float(positions.min())
        if most > upper + LIMIT_TOLERANCE:
            report.clamped[name] = most, upper
        elif least < lower - LIMIT_TOLERANCE:
            report.clamped[name] = least, lower
    return report
