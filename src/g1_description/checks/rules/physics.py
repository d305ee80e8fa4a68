"""Simulated motions: tracking errors, saturated motors, and falls."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from g1_description.checks.intervals import intervals, time_share
from g1_description.checks.measured import Measured
from g1_description.checks.rule import Rule, units
from g1_description.checks.thresholds import Level
from g1_description.checks.verdict import BY_TIME, Finding
from g1_description.choices import ENGINE_LIBRARIES
from g1_description.robot.rotation import conjugate, rotate
from g1_description.sim.rollout import Rollout

AT_LIMIT = 0.999
"""Fraction of its limit at which an effort is shown as saturated."""

NEED_TIME = 0.05
"""Over which needed efforts are averaged, in [s]: contacts have peaks of a step."""

TIPPED = np.radians(5.0)
"""Lean at which a fall is said to begin, in [rad]."""


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
        is_full = _is_saturated(played, name)[rows]
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
            f"the motor of {name} is saturated {100.0 * fraction:.3g} % of the "
            "simulated time"
            f": it {_need_text(measured, name)}",
        )


def saturated_joints(measured: Measured) -> list[str]:
    """List the joints whose motors are saturated for longer than a threshold."""
    report, thresholds = _played(measured).report, measured.robot.thresholds
    return [
        name
        for name, share in zip(report.joint_names, report.limit_shares)
        if SATURATION.severity(thresholds, float(share))[0]
    ]


def _is_saturated(played: Rollout, joint: str) -> np.ndarray:
    """Return in which rows a motor is at its limit, shape (n,)."""
    column = played.joint_names.index(joint)
    most = AT_LIMIT * played.effort_limits[column]
    return np.asarray(np.abs(played.efforts[:, column]) >= most)


def _need(measured: Measured, joint: str) -> tuple[float, float]:
    """Find the effort that a motor needs while it is saturated, and its limit.

    It is what a motor without a limit gives at the same times, where both motors still
    do the same; NaN if that is unknown, or not more than the limit.
    """
    played, freely = _played(measured), measured.unlimited
    column = played.joint_names.index(joint)
    limit = float(played.effort_limits[column])
    if freely is None:
        return np.nan, limit
    count = min(len(played.times), len(freely.times))
    efforts = freely.mean_efforts[:count, column]
    period = (freely.times[-1] - freely.times[0]) / max(len(freely.times) - 1, 1)
    width = int(np.clip(round(NEED_TIME / max(period, 1e-9)), 1, count))
    means = np.abs(np.convolve(efforts, np.full(width, 1.0 / width), "same"))
    needed = means[_is_saturated(played, joint)[:count]].max(initial=0.0)
    return float(needed) if needed > limit else np.nan, limit


def _need_text(measured: Measured, joint: str) -> str:
    """Write how much effort a motor needs and has."""
    unit = {each.name: units(each)[1] for each in measured.robot.joints}[joint]
    needed, limit = _need(measured, joint)
    has = f"has {limit:.3g} {unit}"
    return has if np.isnan(needed) else f"needs {needed:.3g} {unit} and {has}"


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
        f"the robot falls at {time:.3f} s{_lean_text(played)}",
        ((x, y, z),),
    )


def _lean_text(played: Rollout) -> str:
    """Write to which side a robot leans more than its motion, and since when."""
    desired = played.desired_base_poses
    if desired is None:
        desired = played.base_poses[:1]
    up = np.array([0.0, 0.0, 1.0])
    # The world's upward axis in the frames of the bases.
    ups = [rotate(conjugate(b[:, 3:]), up) for b in (played.base_poses, desired)]
    leans = np.arccos(np.clip((ups[0] * ups[1]).sum(axis=1), -1.0, 1.0))
    if not leans[-1] > TIPPED:  # it sinks
        return ""
    # A base that leans forwards has the world's upward axis behind its own.
    x, y = (ups[1] - ups[0])[-1, :2]
    if abs(x) > abs(y):
        where = "forwards" if x > 0.0 else "backwards"
    else:
        where = "to the left" if y > 0.0 else "to the right"
    upright = np.flatnonzero(leans <= TIPPED)
    first = int(upright[-1]) + 1 if len(upright) else 0
    return (
        f": it leans {where}, by more than {np.degrees(TIPPED):.0f} degrees from "
        f"{played.times[first]:.3f} s on"
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
    begin = f"In simulation with {ENGINE_LIBRARIES[played.engine]}"
    if played.fell_at is not None:
        outcome = f"the robot falls at {played.fell_at:.3f} s"
        end = measured.motion.times[-1]
        if played.fell_at < end:
            outcome += f" of {end:.3f} s, where the simulation ends"
    elif measured.robot.is_fixed:
        outcome = "the base is fixed"
    report, names = played.report, played.report.joint_names
    if not names:
        return f"{begin} {outcome}."
    kinds = {joint.name: units(joint)[0] for joint in measured.robot.joints}
    figures = physics_figures(played)
    unit = " or ".join(dict.fromkeys(kinds[name] for name in names))
    return (
        f"{begin} {outcome}; tracking error of {len(names)} joint"
        f"{'s' if len(names) > 1 else ''}: rms "
        f"{figures['rms_tracking_error']:.4f} {unit}, largest "
        f"{figures['largest_tracking_error']:.4f} {unit} "
        f"({names[int(np.argmax(report.largest_errors))]})."
        f"{_limits_text(measured)}"
    )


def _limits_text(measured: Measured) -> str:
    """Explain the limits of saturated motors; empty if none was."""
    played, freely = _played(measured), measured.unlimited
    if freely is None:
        return ""
    joints = saturated_joints(measured)
    ratios = [need / limit for need, limit in (_need(measured, j) for j in joints)]
    known = [(ratio, joint) for ratio, joint in zip(ratios, joints) if ratio > 1.0]
    text = ""
    if known:
        joint = max(known)[1]
        text += f" The largest lack of effort: {joint} {_need_text(measured, joint)}."
    if played.fell_at is not None:
        text += " With motors without limits it "
        if freely.fell_at is None:
            text += "does not fall."
        else:
            text += f"falls, too, at {freely.fell_at:.3f} s."
    return text


TRACKING = Rule(
    name="tracking",
    grouping=BY_TIME,
    about="joints far from their desired positions in [simulation](physics_check.md)",
    level=Level(0.2, None),
    limit="rad or m, of a joint; with --physics",
    find=_tracking,
    needs=("physics",),
    requires="`--physics`",
)
SATURATION = Rule(
    name="saturation",
    grouping=BY_TIME,
    about="saturated motors, with what they need and have",
    level=Level(0.1, None),
    limit="fraction of the time at the motor's limit; with --physics",
    unit="of the time",
    find=_saturation,
    needs=("physics",),
    requires="`--physics`",
)
FALL = Rule(
    name="fall",
    about="a fall of the robot, its side and when it began to lean",
    level=Level(None, 0.0),
    limit="1 if the robot falls; with --physics",
    find=_fall,
    needs=("physics", "free base"),
    requires="`--physics`",
)
