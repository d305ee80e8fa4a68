"""What physics says of a motion: how motors follow it, and whether the robot falls."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import replace

import numpy as np

from g1_description.checks.finding import (
    Finding,
    intervals,
    sorted_findings,
    time_share,
)
from g1_description.checks.limits import units
from g1_description.checks.thresholds import Level, Thresholds
from g1_description.checks.verdict import Verdict
from g1_description.errors import G1DescriptionError
from g1_description.motion.motion import Motion
from g1_description.motion.motors import Motors
from g1_description.robot.assembly import WORLD, base_of
from g1_description.robot.description import Description
from g1_description.sim.rollout import Conditions, Rollout, rollout

CHECKS = ("tracking", "saturation", "fall")
"""Names of the checks that need a simulation."""

AT_LIMIT = 0.999
"""Share of its limit from which on an effort is shown as one at its limit."""


class PhysicsCheck:
    """Plays motions of one robot in physics, and checks what happens."""

    def __init__(
        self,
        description: Description,
        thresholds: Thresholds,
        motors: Motors | None = None,
        fixed_base: bool = False,
    ) -> None:
        """Prepare.

        Args:
            description: The robot.
            thresholds: What is a warning and what a failure.
            motors: What drives the joints; None: motors as strong as the robot's file
                says.
            fixed_base: Whether something holds the base.
        """
        self.description, self._thresholds = description, thresholds
        self._joints = {joint.name: joint for joint in description.movable_joints}
        self._is_fixed = fixed_base or base_of(description)[0] == WORLD
        self._conditions = Conditions(
            motors=motors, fixed_base=fixed_base, stops_at_fall=True
        )

    def added(
        self, verdict: Verdict, motion: Motion, only: Collection[str] = ()
    ) -> Verdict:
        """Add what physics says to a verdict.

        Args:
            verdict: What else was found of the motion.
            motion: The motion.
            only: Names of the checks to make; none: all.
        """
        wanted = [name for name in CHECKS if not only or name in only]
        skipped = self._skipped()
        played = None
        if set(wanted) - set(skipped):
            try:
                played = rollout(self.description, motion.trajectory, self._conditions)
            except G1DescriptionError as error:
                skipped = dict.fromkeys(wanted, str(error).rstrip("."))
        made = [name for name in wanted if name not in skipped]
        more = Verdict(verdict.robot) if played is None else self._verdict(played)
        findings = [finding for finding in more.findings if finding.check in made]
        notes = [note for note in more.notes if note not in verdict.notes]
        left_out = {name: skipped[name] for name in wanted if name in skipped}
        return replace(
            verdict,
            findings=sorted_findings([*verdict.findings, *findings]),
            checked=(*verdict.checked, *made),
            skipped={**verdict.skipped, **left_out},
            figures={**verdict.figures, **more.figures},
            notes=(*verdict.notes, *notes),
        )

    def _skipped(self) -> dict[str, str]:
        """Name the checks that are not made of any motion, and why not."""
        skipped = {
            name: "it has no threshold"
            for name in CHECKS
            if not getattr(self._thresholds, name).is_checked
        }
        if self._is_fixed:
            skipped["fall"] = "the base is fixed"
        return skipped

    def _verdict(self, played: Rollout) -> Verdict:
        """Check what happened."""
        thresholds, fell_at = self._thresholds, played.fell_at
        findings: list[Finding | None] = []
        for number, name in enumerate(played.report.joint_names):
            unit = units(self._joints[name])[0]
            findings.append(_tracking(played, number, unit, thresholds.tracking))
            findings.append(_saturation(played, number, thresholds.saturation))
        if fell_at is not None:
            findings.append(_fall(played, fell_at, thresholds.fall))
        figures = {} if fell_at is None else {"fall_time": fell_at}
        figures.update(_errors(played))
        return Verdict(
            self.description.name,
            sorted_findings(findings),
            figures=figures,
            notes=(*played.left_out, self._summary(played, figures)),
        )

    def _summary(self, played: Rollout, figures: Mapping[str, float]) -> str:
        """Say in a sentence what happened."""
        outcome = "the robot does not fall"
        if played.fell_at is not None:
            outcome = f"the robot falls at {played.fell_at:.3f} s"
        elif self._is_fixed:
            outcome = "the base is fixed"
        report = played.report
        if not report.joint_names:
            return f"In physics {outcome}."
        names = report.joint_names
        unit = " or ".join(dict.fromkeys(units(self._joints[n])[0] for n in names))
        return (
            f"In physics {outcome}; tracking error of {len(names)} joint"
            f"{'s' if len(names) > 1 else ''}: rms "
            f"{figures['rms_tracking_error']:.4f} {unit}, largest "
            f"{figures['largest_tracking_error']:.4f} {unit} "
            f"({names[int(np.argmax(report.largest_errors))]})."
        )


def _errors(played: Rollout) -> dict[str, float]:
    """Compute the errors over all joints, in [rad] or [m]."""
    report = played.report
    if not report.joint_names:
        return {}
    return {
        "rms_tracking_error": float(np.sqrt(np.mean(report.rms_errors**2))),
        "largest_tracking_error": float(report.largest_errors.max()),
    }


def _tracking(played: Rollout, number: int, unit: str, level: Level) -> Finding | None:
    """Check how far a joint is from where it should be."""
    report = played.report
    name, worst = report.joint_names[number], float(report.largest_errors[number])
    severity, bound = level.severity(worst)
    if bound is None:
        return None
    time = float(report.largest_error_times[number])
    rows, column = _rows(played), played.joint_names.index(name)
    errors = np.abs(played.positions[rows, column] - played.wanted[rows, column])
    when = intervals(played.times[rows], errors > bound) or ((time, time),)
    return Finding(
        "tracking",
        severity,
        (name,),
        worst,
        bound,
        unit,
        min(when[0][0], time),
        time,
        time_share(played.times[rows], errors > bound),
        when,
        f"{name} is {worst:.4g} {unit} from where it should be at {time:.3f} s",
    )


def _saturation(played: Rollout, number: int, level: Level) -> Finding | None:
    """Check how long a motor gives all it can."""
    report = played.report
    name, share = report.joint_names[number], float(report.limit_shares[number])
    severity, bound = level.severity(share)
    if bound is None:
        return None
    first = float(report.first_limit_times[number])
    rows, column = _rows(played), played.joint_names.index(name)
    most = AT_LIMIT * played.effort_limits[column]
    is_full = np.abs(played.efforts[rows, column]) >= most
    return Finding(
        "saturation",
        severity,
        (name,),
        share,
        bound,
        "of the time",
        first,
        first,
        share,
        intervals(played.times[rows], is_full) or ((first, first),),
        f"the motor of {name} is at its limit in {100.0 * share:.3g} % of the time",
    )


def _fall(played: Rollout, time: float, level: Level) -> Finding | None:
    """Check a fall.

    Args:
        played: What happened.
        time: When the robot fell, in [s].
        level: The thresholds.
    """
    severity, bound = level.severity(1.0)
    if bound is None:
        return None
    x, y, z = played.base_poses[-1, :3].tolist()
    return Finding(
        "fall",
        severity,
        (),
        1.0,
        bound,
        "",
        time,
        time,
        0.0,
        ((time, time),),
        f"the robot falls at {time:.3f} s",
        ((x, y, z),),
    )


def _rows(played: Rollout) -> np.ndarray:
    """Choose the rows until the end of the motion, at least one."""
    begin = played.times[0]
    is_motion = played.times <= begin + max(played.report.duration, 0.0) + 1e-9
    return np.flatnonzero(is_motion)
