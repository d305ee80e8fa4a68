"""Motions that models go through, step by step."""

from __future__ import annotations

from collections.abc import Collection
from typing import NamedTuple

import numpy as np

from g1_description.errors import InvalidValueError, UnknownNameError
from g1_description.motion.playlist import Playback, Playlist, Setpoint
from g1_description.motion.tracking import (
    FallDetector,
    FallLimits,
    TrackingRecorder,
    TrackingReport,
)
from g1_description.motion.trajectory import Trajectory
from g1_description.sim.bullet.engine import Engine
from g1_description.sim.model import Model, Report

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


LIMIT_TOLERANCE = 1e-3
"""How far a motion may take a joint beyond its limits, in [rad] or [m]: files round
positions, and limits too."""


class Motions:
    """The motions of all models.

    In ``kinematic`` physics they set joints and base at each step; in ``hold`` they
    set what the motors follow, the base is left to physics, and how well they follow
    is told afterwards.
    """

    def __init__(self, engine: Engine, fall_limits: FallLimits | None = None) -> None:
        """Begin without any.

        Args:
            engine: What computes the steps.
            fall_limits: From where on a base has fallen, in ``hold``.
        """
        self._engine = engine
        self.fall_limits = fall_limits
        """From where on a base has fallen, for motions that begin from now on."""
        self._playlists: dict[Model, Playlist] = {}
        self._trackers: dict[Playback, MotionTracker] = {}
        self._tracked: list[TrackedMotion] = []

    def play(self, model: Model, trajectory: Trajectory, start_ns: int) -> Report:
        """Let a model go through a motion, from the first step at or after its start.

        Args:
            model: The model.
            trajectory: The motion; joints that the model does not have are ignored.
            start_ns: When its times count from, in [ns] of simulated time.

        Returns:
            Which joints the model does not have, and which samples are beyond limits.

        Raises:
            InvalidValueError: If the model cannot do any of it.
        """
        has_base = trajectory.base_poses is not None
        if self._engine.physics == "limp":
            raise InvalidValueError("nothing drives the joints in limp physics")
        if has_base and (not model.trees or model.trees[0].is_on_world):
            raise InvalidValueError(f"the base of {model.name} is fixed to the world")
        is_moved = has_base and not self._engine.is_dynamic
        if not (is_moved or model.joint_rows(trajectory.joint_names)):
            raise InvalidValueError(
                f"there is nothing of {model.name} that the motion can move"
            )
        playlist = self._playlists.setdefault(model, Playlist(model.joint_names))
        playlist.add(trajectory, start_ns)
        return _report(model, trajectory)

    def stop(self, model: Model, names: Collection[str] = ()) -> None:
        """Stop joints where they are, or all of a model.

        Args:
            model: The model.
            names: Its joints; none: all of them, and the base.

        Raises:
            UnknownNameError: If it has no such joint; nothing is stopped.
        """
        unknown = [name for name in names if model.joint_row(name) is None]
        if unknown:
            raise UnknownNameError(
                f"{model.name} has no movable joint {', '.join(unknown)}"
            )
        rows = model.joint_rows(names or model.joint_names)
        playlist = self._playlists.get(model)
        for playback in playlist.moving() if playlist else ():
            held = np.intersect1d(playback.rows, np.array(rows, dtype=int))
            base = playback.moves_base and not names
            still = model.target[held], np.zeros(len(held))
            root = (model.root_poses[0], np.zeros(6)) if base else ()
            self._set(model, Setpoint(held, *still, *root))
        self.release(model, rows, base=not names)

    def release(
        self, model: Model, rows: Collection[int] = (), base: bool = False
    ) -> None:
        """Leave some of a model to another command.

        Args:
            model: The model.
            rows: Rows of its movable joints.
            base: Whether the base is among it.
        """
        if model in self._playlists:
            self._playlists[model].release(rows, base)

    def forget(self, model: Model) -> None:
        """End all motions of a model; motors hold what they were to reach last."""
        playlist = self._playlists.pop(model, None)
        if playlist and self._engine.is_dynamic:
            for body in self._engine.bodies(model):
                body.joints.hold_position(range(len(model.joint_names)))
        kept = [item for item in self._trackers.items() if item[1].model is not model]
        self._trackers = dict(kept)

    def step(self, time_ns: int) -> None:
        """Set the models to where their motions want them at a time in [ns]."""
        for model, playlist in [*self._playlists.items()]:
            if playlist.is_waiting:
                playlist.begin(time_ns, _state(model))
            for playback in playlist.moving():
                wanted = self._set(model, playback.setpoint(time_ns))
                if self._engine.is_dynamic and not playback.is_single:
                    self._track(model, playback, wanted)
            playlist.drop_over(time_ns)
            if not playlist:
                del self._playlists[model]

    def _track(self, model: Model, playback: Playback, wanted: Setpoint) -> None:
        """Note what the motors are to reach in the next step."""
        if playback not in self._trackers:
            tracker = MotionTracker(self._engine, model, playback, self.fall_limits)
            self._trackers[playback] = tracker
        self._trackers[playback].expect(wanted)

    def measure(self, time_ns: int) -> None:
        """Compare the models with their motions after a step, at a time in [ns]."""
        for playback, tracker in [*self._trackers.items()]:
            if not tracker.measure(time_ns):
                self._tracked.append(tracker.tracked())
                del self._trackers[playback]

    def tracker(self, model: Model) -> MotionTracker | None:
        """Return what watches the newest motion of a model; None where nothing does."""
        own = [one for one in self._trackers.values() if one.model is model]
        return own[-1] if own else None

    def efforts(self, model: Model) -> np.ndarray:
        """Read what a model's motors applied in the last step, in [N m] or [N].

        Zeros before the first one, shape (n_joints,).
        """
        return self._engine.efforts(model)

    def effort_limits(self, model: Model) -> np.ndarray:
        """Return what a model's motors can give at most, in [N m] or [N].

        Infinite where neither the robot's file nor that of the motors has a limit,
        shape (n_joints,).
        """
        return self._engine.effort_limits(model)

    def take_tracked(self) -> list[TrackedMotion]:
        """Return what became of the motions that motors followed, since last asked.

        Motions of a single configuration have no report. One that was replaced has a
        report of what was done.
        """
        tracked, self._tracked = self._tracked, []
        return tracked

    def _set(self, model: Model, wanted: Setpoint) -> Setpoint:
        """Set a model, or what its motors follow; return what it is set to."""
        wanted = _inside_limits(model, wanted)
        if self._engine.is_dynamic:
            model.target[wanted.rows] = wanted.positions
            for body in self._engine.bodies(model):
                body.joints.follow(wanted.rows, wanted.positions, wanted.velocities)
            return wanted
        model.set_moving(wanted)
        self._engine.write(model)
        return wanted


def _state(model: Model) -> Setpoint:
    """Return where a model is, or what its motors hold."""
    rows = np.arange(len(model.joint_names))
    base = (model.root_poses[0], model.root_twists[0]) if model.trees else ()
    return Setpoint(rows, model.target, model.velocity, *base)


def _inside_limits(model: Model, wanted: Setpoint) -> Setpoint:
    """Move joints that are too far beyond their limits there, and stop them."""
    lower = model.lower[wanted.rows] - LIMIT_TOLERANCE
    upper = model.upper[wanted.rows] + LIMIT_TOLERANCE
    positions = wanted.positions
    inside = np.minimum(np.maximum(positions, lower), upper)
    velocities = np.where(inside == positions, wanted.velocities, 0.0)
    return wanted._replace(positions=inside, velocities=velocities)


def _report(model: Model, trajectory: Trajectory) -> Report:
    """Find what of a motion a model will not do."""
    report = Report()
    for column, name in enumerate(trajectory.joint_names):
        row = model.joint_row(name)
        if row is None:
            report.unknown.append(name)
            continue
        lower, upper = float(model.lower[row]), float(model.upper[row])
        positions = trajectory.positions[:, column]
        most, least = float(positions.max()), float(positions.min())
        if most > upper + LIMIT_TOLERANCE:
            report.clamped[name] = most, upper
        elif least < lower - LIMIT_TOLERANCE:
            report.clamped[name] = least, lower
    return report
