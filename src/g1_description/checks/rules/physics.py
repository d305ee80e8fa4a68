"""Simulated motions: tracking errors, saturated motors, and falls."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from g1_description.checks.causes import BY_TIME
from g1_description.checks.intervals import intervals, time_share
from g1_description.checks.measured import Measured
from g1_description.checks.rule import Rule, units
from g1_description.checks.thresholds import Level
from g1_description.checks.verdict import Finding
from g1_description.sim.rollout import Rollout

AT_LIMIT = 0.999
"""Fraction of its limit at which an effort is shown as saturated."""


def _played(measured: Measured) -> Rollout:
    """Return the simulated motion."""
    assert measured.played is not None
    return measured.played


def _tracking(rule: Rule, measured: Measured) -> Iterator[Finding]:
    """Find joints with large tracking errors."""
    played = _played(measured)
    report, rows = played.report, _rows(played)
    kinds = {joint.name: units(joint)[0] for joint in measured.robot.joints}
    for number, name in enumerate(report.joint_names):
        worst = float(report.largest_errors[number])
        severity, bound = rule.severity(measured.robot.thresholds, worst)
        if not severity:
            continue
        unit, column = kinds[name], played.joint_names.index(name)
        time = float(report.largest_error_times[number])
        errors = np.abs(played.positions[rows, column] - played.desired[rows, column])
        when = intervals(played.times[rows], errors > bound) or ((time, time),)
        yield Finding(
            rule.name,
            severity,
            (name,),
            worst,
            bound,
            unit,
            min(when[0][0], time),
            time,
            time_share(played.times[rows], errors > bound),
            when,
            f"{name} is {worst:.4g} {unit} off its desired position at {time:.3f} s",
        )


def _saturation(rule: Rule, measured: Measured) -> Iterator[Finding]:
    """Find saturated motors."""
    played = _played(measured)
    report, rows = played.report, _rows(played)
    for number, name in enumerate(report.joint_names):
        fraction = float(report.limit_shares[number])
        severity, bound = rule.severity(measured.robot.thresholds, fraction)
        if not severity:
            continue
        first = float(report.first_limit_times[number])
        column = played.joint_names.index(name)
        most = AT_LIMIT * played.effort_limits[column]
        is_full = np.abs(played.efforts[rows, column]) >= most
        yield Finding(
            rule.name,
            severity,
            (name,),
            fraction,
            bound,
            rule.unit,
            first,
            first,
            fraction,
            intervals(played.times[rows], is_full) or ((first, first),),
            f"the motor of {name} is saturated {100.0 * fraction:.3g} % of the time",
        )


def _fall(rule: Rule, measured: Measured) -> Iterator[Finding]:
    """Find a fall."""
    played = _played(measured)
    severity, bound = rule.severity(measured.robot.thresholds, 1.0)
    time = played.fell_at
    if time is None or not severity:
        return
    x, y, z = played.base_poses[-1, :3].tolist()
    yield Finding(
        rule.name,
        severity,
        (),
        1.0,
        bound,
        rule.unit,
        time,
        time,
        0.0,
        ((time, time),),
        f"the robot falls at {time:.3f} s",
        ((x, y, z),),
    )


def _rows(played: Rollout) -> np.ndarray:
    """List the rows until the end of the motion, at least one."""
    begin = played.times[0]
    is_motion = played.times <= begin + max(played.report.duration, 0.0) + 1e-9
    return np.flatnonzero(is_motion)


def physics_figures(played: Rollout) -> dict[str, float]:
    """Compute the time of a fall in [s], and errors over all joints in [rad] or [m]."""
    report = played.report
    found = {} if played.fell_at is None else {"fall_time": played.fell_at}
    if report.joint_names:
        rms = float(np.sqrt(np.mean(report.rms_errors**2)))
        found["rms_tracking_error"] = rms
        found["largest_tracking_error"] = float(report.largest_errors.max())
    return found


def physics_summary(measured: Measured) -> str:
    """Describe the simulated motion in a sentence."""
    played, outcome = _played(measured), "the robot does not fall"
    if played.fell_at is not None:
        outcome = f"the robot falls at {played.fell_at:.3f} s"
    elif measured.robot.is_fixed:
        outcome = "the base is fixed"
    report, names = played.report, played.report.joint_names
    if not names:
        return f"In simulation {outcome}."
    kinds = {joint.name: units(joint)[0] for joint in measured.robot.joints}
    figures = physics_figures(played)
    unit = " or ".join(dict.fromkeys(kinds[name] for name in names))
    return (
        f"In simulation {outcome}; tracking error of {len(names)} joint"
        f"{'s' if len(names) > 1 else ''}: rms "
        f"{figures['rms_tracking_error']:.4f} {unit}, largest "
        f"{figures['largest_tracking_error']:.4f} {unit} "
        f"({names[int(np.argmax(report.largest_errors))]})."
    )


TRACKING = Rule(
    name="tracking",
    grouping=BY_TIME,
    about="joints far from their desired positions in [simulation](#what-physics-says)",
    level=Level(0.2, None),
    limit="rad or m, of a joint; with --physics",
    find=_tracking,
    needs=("physics",),
    requires="`--physics`",
)
SATURATION = Rule(
    name="saturation",
    grouping=BY_TIME,
    about="saturated motors",
    level=Level(0.1, None),
    limit="fraction of the time at the motor's limit; with --physics",
    unit="of the time",
    find=_saturation,
    needs=("physics",),
    requires="`--physics`",
)
FALL = Rule(
    name="fall",
    about="a fall of the robot",
    level=Level(0.0, None),
    limit="1 if the robot falls; with --physics",
    find=_fall,
    needs=("physics", "free base"),
    requires="`--physics`",
)
