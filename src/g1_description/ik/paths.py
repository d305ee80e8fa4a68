"""Motions in which links follow targets: smooth ones, or sample after sample."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from g1_description.errors import InvalidValueError
from g1_description.ik.inverse_kinematics import ROUNDS, InverseKinematics
from g1_description.ik.limits import Course, TrajectoryBounds, limit_name
from g1_description.ik.options import ZMP, IkOptions, has_carried
from g1_description.ik.results import IkResult, error_text
from g1_description.ik.sampled import Problem
from g1_description.ik.solver import (
    TOLERANCE,
    Configuration,
    Linearization,
    descend,
    last,
    search,
)
from g1_description.ik.targets import as_target, of_samples
from g1_description.ik.trajectory import Candidate, Trajectory
from g1_description.motion.motion import Motion
from g1_description.text import listed

SPEED_SHARE = 0.999
"""Share of the velocity limits that paths use: others round to the limit itself."""

PATH_STEPS = 20
"""Most steps from one sample of a path to the next."""

KINDS_OF_BOUNDS = ("limit", "largest velocity", "largest acceleration")
"""Names of bounds by their order."""

SHORTEST, LONGEST = 1e-3, 300.0
"""Durations of trajectories, in [s]: longer ones take gigabytes."""

MAX_REASONS = 4
"""Most bounds and limits in a message."""

AROUND = 0.3
"""Time from where a target is missed by most in which these are reached, in [s]."""


@dataclass(frozen=True, eq=False)
class IkPath:
    """The motion that inverse kinematics found."""

    motion: Motion
    """With the base, within limits of positions and velocities."""

    results: tuple[IkResult, ...]
    """Results of the samples."""

    reason: str = ""
    """Sentences on the bounds and limits that are reached where a target is missed by
    most, and that are exceeded; empty if none is missed, or without ``smooth``."""

    @property
    def reached(self) -> bool:
        """Whether all targets are reached in all samples."""
        return not self.message

    @property
    def message(self) -> str:
        """Sentences on the first sample that misses a target; empty if none does."""
        missed = [row for row, result in enumerate(self.results) if not result.reached]
        if not missed:
            return ""
        first, count = missed[0], f"{len(missed)} of {len(self.results)} samples"
        time, message = self.motion.times[first], self.results[first].message
        text = f"Not all is reached in {count}, first at {time:.2f} s. {message}"
        return " ".join(part for part in (text, self._worst(), self.reason) if part)

    def _worst(self) -> str:
        """Say where a target is missed by most."""
        errors = [
            (error.normalized, row, name)
            for row, result in enumerate(self.results)
            for name, error in result.errors.items()
        ]
        largest, row, name = max(errors, default=(0.0, 0, ""))
        if largest <= 1.0:
            return ""
        text = error_text(self.results[row].errors[name])
        return (
            f"The largest distance from its target is that of {name}, {text} at "
            f"{self.motion.times[row]:.2f} s."
        )


class PathKinematics(InverseKinematics):
    """Inverse kinematics of one robot along paths."""

    def path(
        self,
        times: np.ndarray,
        targets: Mapping[str, Any],
        positions: np.ndarray,
        base: np.ndarray,
        options: IkOptions,
    ) -> IkPath:
        """Follow targets sample after sample, within velocity limits of joints.

        Args:
            times: Times of the samples in [s], increasing, shape (n,).
            targets: As for ``solve``, with an axis of the samples or without, or
                functions of time.
            positions: As for ``solve``, before the first sample.
            base: Pose of the base link at the start.
            options: Conditions on all configurations; fixed links stay as at the start.

        Raises:
            G1DescriptionError: As for ``solve``, and if lengths do not match.
        """
        _check_times(times)
        start = self._configuration(positions, base)
        follow = partial(self._followed, times, targets, options, start)
        return _last_round(follow, has_carried(targets, options.scene))

    def _followed(
        self,
        times: np.ndarray,
        targets: Mapping[str, Any],
        options: IkOptions,
        start: Configuration,
        course: Course | None,
    ) -> tuple[IkPath, Course]:
        """Follow targets sample after sample, relative to objects as in a course."""
        ways = self._tasks(_at(times, targets), options, start, times, course)
        tasks, constraints = self._problem(ways, start, options, times)
        given = [task.at(0) for task in tasks.values()]
        first = constraints.at(0, self._course(times[:1], start))
        posture = start.position
        view, steps = last(search(self._solver, start, given, first, posture))
        results, links = [self._result(tasks, view, steps)], [view.jacobians.link_poses]
        for row, duration in enumerate(np.diff(times), start=1):
            given = [task.at(row) for task in tasks.values()]
            now = view.configuration
            reach = SPEED_SHARE * self._speed * duration
            bounds = replace(
                constraints.at(row, Course(times[:row], np.array(links))),
                lower=np.maximum(constraints.lower, now.position - reach),
                upper=np.minimum(constraints.upper, now.position + reach),
            )
            first_view = self._solver.view(now, given, bounds)
            view, steps = last(descend(self._solver, first_view, posture, PATH_STEPS))
            results.append(self._result(tasks, view, steps))
            links.append(view.jacobians.link_poses)
        found = IkPath(self._motion(times, results), tuple(results))
        return found, Course(times, np.array(links))

    def trajectory(
        self,
        times: np.ndarray,
        targets: Mapping[str, Any],
        positions: np.ndarray,
        base: np.ndarray,
        options: IkOptions,
        bounds: TrajectoryBounds,
    ) -> IkPath:
        """Follow targets by a smooth motion, found as a whole.

        Args:
            times: As for ``path``, like all but the last one.
            targets: Likewise.
            positions: Likewise.
            base: Likewise.
            options: Likewise.
            bounds: Bounds of velocities and accelerations.

        Raises:
            G1DescriptionError: As for ``path``.
        """
        _check_times(times)
        if not isinstance(bounds, TrajectoryBounds):
            raise InvalidValueError(
                f"bounds must be TrajectoryBounds(...) (got {str(bounds)[:80]})."
            )
        duration = float(times[-1] - times[0])
        if len(times) > 1 and not SHORTEST <= duration <= LONGEST:
            raise InvalidValueError(
                f"A trajectory lasts from {SHORTEST:g} to {LONGEST:g} s (got "
                f"{duration:g}). Times are in s; smooth=False takes any."
            )
        if len(times) == 1:
            is_of_zmp = options.balance == ZMP
            at_rest = replace(options, balance=True) if is_of_zmp else options
            return self.path(times, targets, positions, base, at_rest)
        start = self._configuration(positions, base)
        follow = partial(self._smooth, times, targets, options, bounds, start)
        return _last_round(follow, has_carried(targets, options.scene))

    def _smooth(
        self,
        times: np.ndarray,
        targets: Mapping[str, Any],
        options: IkOptions,
        bounds: TrajectoryBounds,
        start: Configuration,
        course: Course | None,
    ) -> tuple[IkPath, Course]:
        """Follow targets by a smooth motion, relative to objects as in a course."""
        ways = self._tasks(_at(times, targets), options, start, times, course)
        tasks, constraints = self._problem(ways, start, options, times, True)
        given = times, [*tasks.values()], constraints, start, bounds, self._speed
        search_ = Trajectory(self._solver, Problem(*given))
        found, views = search_.solve()
        results = [self._result(tasks, view, found.steps, False) for view in views]
        missed = [row for row, result in enumerate(results) if not result.reached]
        reason = ""
        if missed:
            largest = max(missed, key=lambda row: views[row].badness)
            near = np.flatnonzero(np.abs(times - times[largest]) <= AROUND)
            reason = self._reason(search_, found, views, near)
            reason += self._excesses(times, views)
            reason = reason.lstrip() or (
                "No limit is reached there: it is out of reach, or changes too quickly."
            )
        path = IkPath(self._motion(times, results), tuple(results), reason)
        return path, Course(times, found.view.jacobians.link_poses)

    def _reason(
        self,
        search_: Trajectory,
        found: Candidate,
        views: Sequence[Linearization],
        rows: np.ndarray,
    ) -> str:
        """Describe which bounds and limits are reached at some samples, if any."""
        names = [*6 * ["the base"], *self._names]
        phrases = [
            f"{names[column]} is at its {KINDS_OF_BOUNDS[order]}"
            for order, column in search_.at_bounds(found, rows)
        ]
        for view in (views[row] for row in rows):
            for limit, (_, room) in zip(view.bounds.limits, view.approaches):
                if abs(room.min(initial=np.inf)) < TOLERANCE[0]:  # else it is exceeded
                    near = [*self._at_objects(limit, view)]
                    phrases = near + phrases if near else [*phrases, limit_name(limit)]
        if not phrases:
            return ""
        return f"There {listed([*dict.fromkeys(phrases)][:MAX_REASONS])}."

    def _excesses(self, times: np.ndarray, views: Sequence[Linearization]) -> str:
        """Say which limits are exceeded, by how much at most, and when."""
        texts = []
        for number in range(len(views[0].bounds.limits)):
            row = int(np.argmax([view.excesses[number] for view in views]))
            message = self._excess(views[row], number)
            if message:
                texts.append(f" At {times[row]:.2f} s {message}.")
        return "".join(texts)

    def _motion(self, times: np.ndarray, results: Sequence[IkResult]) -> Motion:
        """Return the motion of results."""
        return Motion(
            times,
            self._names,
            np.array([result.positions for result in results]),
            base_poses=np.array([result.base for result in results]),
        )


def _last_round(
    follow: Callable[[Course | None], tuple[IkPath, Course]], is_repeated: bool
) -> IkPath:
    """Follow targets, and again relative to objects as links carried them before."""
    found, course = follow(None)
    for _ in range(ROUNDS - 1 if is_repeated else 0):
        found, course = follow(course)
    return found


def _check_times(times: np.ndarray) -> None:
    """Refuse times that are none, or do not increase."""
    if times.ndim != 1 or not np.isfinite(times).all():
        raise InvalidValueError(
            f"The times of a path must be a row of numbers (got {str(times)[:80]})."
        )
    if len(times) == 0:
        raise InvalidValueError("A path needs at least one sample (got none).")
    if not (np.diff(times) > 0.0).all():
        raise InvalidValueError("The times of a path must increase.")


def _at(times: np.ndarray, targets: Mapping[str, Any]) -> Mapping[str, Any]:
    """Evaluate targets that are functions of time."""
    if not isinstance(targets, Mapping):
        return targets  # refused with a message
    found = dict(targets)
    for name, given in targets.items():
        if callable(given):
            rows = [as_target(name, given(float(time))) for time in times]
            found[name] = of_samples(name, rows)
    return found
