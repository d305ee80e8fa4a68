"""Limits of joints: position, velocity, acceleration, jerk and effort."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from g1_description.checks.measured import CheckedRobot, Measured
from g1_description.checks.rule import Rule, units
from g1_description.checks.rules.jumps import near_jumps
from g1_description.checks.thresholds import Level, Thresholds
from g1_description.checks.verdict import BY_TIME, Finding
from g1_description.errors import ThresholdError
from g1_description.motion.motion import Motion
from g1_description.robot.description import Description, Joint, limits_of
from g1_description.text import listed, similar_first


def _positions(rule: Rule, measured: Measured) -> Iterator[Finding | None]:
    """Compare positions with their limits."""
    joints, positions = measured.joints, measured.positions
    lower, upper = limits_of(joints)
    above, below = positions - upper, lower - positions
    sizes = np.maximum(above, below)
    for column in rule.columns(measured, sizes):
        joint = joints[column]
        is_above = above[:, column].max() >= below[:, column].max()
        bound, word = (joint.upper, "upper") if is_above else (joint.lower, "lower")
        unit = units(joint)[0]
        text = (
            f"{joint.name} is {{worst:.4g}} {unit} beyond its {word} limit of "
            f"{bound:.4g} {unit}{{when}}"
        )
        yield rule.compared(measured, (joint.name,), sizes[:, column], text, unit)


def _velocities(rule: Rule, measured: Measured) -> Iterator[Finding | None]:
    """Compare velocities with their limits."""
    bounds = np.array([joint.velocity for joint in measured.joints])
    return _rates(rule, measured, measured.velocities, bounds)


def _derived(rule: Rule, measured: Measured) -> Iterator[Finding | None]:
    """Compare accelerations or jerks with their bounds."""
    bounds = getattr(measured.robot.thresholds, f"{rule.name}_bounds")
    accelerations, jerks = measured.once(_derivatives)
    rates = accelerations if rule is ACCELERATION else jerks
    return _rates(
        rule, measured, measured.spread(rates, np.nan), bounds.of(measured.joint_names)
    )


def _derivatives(measured: Measured) -> tuple[np.ndarray, np.ndarray]:
    """Compute accelerations and jerks at the motion's samples."""
    return derivatives(measured.motion)


def _rates(
    rule: Rule, measured: Measured, rates: np.ndarray, bounds: np.ndarray
) -> Iterator[Finding | None]:
    """Compare derivatives, shape (n, n_joints), with bounds, shape (n_joints,)."""
    known = np.where(measured.once(near_jumps).joints, np.nan, rates)
    suffix = {"velocity": "/s", "acceleration": "/s^2", "jerk": "/s^3"}[rule.name]
    words = [units(joint)[0] + suffix for joint in measured.joints]
    return fractions(rule, measured, measured.joints, known, bounds, words)


def fractions(
    rule: Rule,
    measured: Measured,
    joints: Sequence[Joint],
    values: np.ndarray,
    bounds: np.ndarray,
    words: Sequence[str],
) -> Iterator[Finding | None]:
    """Compare values with bounds, as fractions of these.

    Args:
        rule: The check.
        measured: The motion.
        joints: Movable joints.
        values: Values of the joints, shape (n, n_joints); NaN if unknown.
        bounds: Largest magnitudes of the values, shape (n_joints,); infinite without a
            limit.
        words: Units of the values.
    """
    which = "the bound" if rule in (ACCELERATION, JERK) else "its limit"
    is_bounded = bounds > 0.0  # URDF exporters write 0 for unknown limits
    sizes = np.abs(values) / np.where(is_bounded, bounds, np.inf)
    for column in rule.columns(measured, sizes):
        if is_bounded[column]:
            name, unit = joints[column].name, words[column]
            largest = np.nanmax(np.abs(values[:, column]))
            text = (
                f"{name} reaches {largest:.4g} {unit}{{when}}; {which} is "
                f"{bounds[column]:.4g} {unit}"
            )
            yield rule.compared(measured, (name,), sizes[:, column], text)


def derivatives(motion: Motion) -> tuple[np.ndarray, np.ndarray]:
    """Compute the accelerations and jerks of a motion's samples.

    Returns:
        In [rad/s^2] and [rad/s^3], or [m/s^2] and [m/s^3], shape (n, n_joints) each:
        those of the cubic polynomials between samples if the motion has velocities,
        with the larger acceleration of both sides; else differences of neighbouring
        samples. NaN at the ends, where neighbours are missing.
    """
    times, positions = motion.times, motion.positions
    acceleration, jerk = np.full((2, *positions.shape), np.nan)
    h, step = np.diff(times)[:, np.newaxis], np.diff(positions, axis=0)
    if len(times) > 2 and motion.velocities is None:
        middle = (times[2:] - times[:-2])[:, np.newaxis] / 2.0
        acceleration[1:-1] = np.diff(step / h, axis=0) / middle
        jerk[1:-2] = np.diff(acceleration[1:-1], axis=0) / h[1:-1]
    elif len(times) > 1 and motion.velocities is not None:
        v0, v1 = h * motion.velocities[:-1], h * motion.velocities[1:]
        begin = (6.0 * step - 4.0 * v0 - 2.0 * v1) / h**2
        end = (2.0 * v0 + 4.0 * v1 - 6.0 * step) / h**2
        acceleration[:-1] = begin
        is_larger = ~(np.abs(acceleration[1:]) > np.abs(end))
        acceleration[1:][is_larger] = end[is_larger]
        jerk[:-1] = (6.0 * (v0 + v1) - 12.0 * step) / h**3
    return acceleration, jerk


def _no_bounds(robot: CheckedRobot, motion: Motion, name: str) -> str:
    """Return a reason if no joint of a motion has a bound; else empty."""
    bounds = getattr(robot.thresholds, name).of(motion.joint_names)
    return "" if np.isfinite(bounds).any() else "no bounds are set"


def check_bounds(thresholds: Thresholds, description: Description) -> None:
    """Check that bounds refer to joints of a robot.

    Raises:
        ThresholdError: If it has no such joint.
    """
    own = [joint.name for joint in description.movable_joints]
    for name in ("acceleration_bounds", "jerk_bounds"):
        for joint in getattr(thresholds, name).joints:
            if joint not in own:
                raise ThresholdError(
                    f"{name}: {description.name} has no joint '{joint}'. Its joints: "
                    f"{listed(similar_first(joint, own))}."
                )


def zero_limits(description: Description) -> tuple[str, ...]:
    """Report limits of zero, which exporters write for unknown limits."""
    notes = []
    for limit in ("velocity", "effort"):
        joints = description.movable_joints
        names = [joint.name for joint in joints if getattr(joint, limit) == 0.0]
        if names:
            notes.append(
                f"The {limit} limit of {listed(names)} in {description.name} is 0: the "
                f"{limit} is not checked."
            )
    return tuple(notes)


POSITION = Rule(
    name="position",
    about="joints beyond a limit of the URDF",
    level=Level(1e-6, 1e-3),
    limit="rad or m beyond a limit of the URDF",
    find=_positions,
)
VELOCITY = Rule(
    name="velocity",
    grouping=BY_TIME,
    about="joints faster than the URDF allows",
    level=Level(None, 1.0),
    limit="fraction of the URDF's limit",
    unit="of the limit",
    find=_velocities,
    needs=("velocities",),
)
ACCELERATION = Rule(
    name="acceleration",
    grouping=BY_TIME,
    about="joints whose acceleration exceeds a bound in the file of thresholds",
    level=Level(1.0, None),
    limit="fraction of acceleration_bounds",
    unit="of the limit",
    find=_derived,
    needs=("neighbours",),
    skip=lambda robot, motion: _no_bounds(robot, motion, "acceleration_bounds"),
)
JERK = Rule(
    name="jerk",
    grouping=BY_TIME,
    about="joints whose jerk exceeds a bound in the file of thresholds",
    level=Level(1.0, None),
    limit="fraction of jerk_bounds",
    unit="of the limit",
    find=_derived,
    needs=("neighbours",),
    skip=lambda robot, motion: _no_bounds(robot, motion, "jerk_bounds"),
)
