"""Contact forces that a motion needs, and efforts of joints with these."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from g1_description.checks.contact_forces import ContactForces, contact_forces
from g1_description.checks.intervals import time_share
from g1_description.checks.measured import CheckedRobot, Measured
from g1_description.checks.rule import Rule, units
from g1_description.checks.rules.jumps import near_jumps
from g1_description.checks.rules.limits import fractions
from g1_description.checks.support import (
    support_margin,
    support_polygon,
    zero_moment_point,
)
from g1_description.checks.thresholds import Level
from g1_description.checks.verdict import Finding
from g1_description.motion.motion import Motion
from g1_description.robot.dynamics import GRAVITY
from g1_description.robot.rotation import conjugate, rotate

SIDES = ("in front of", "to the left of", "behind", "to the right of")


def forces(measured: Measured) -> ContactForces:
    """Find the forces that a motion needs; call it by ``measured.once``."""
    return contact_forces(measured, measured.once(near_jumps).is_known)


def too_slow(robot: CheckedRobot, motion: Motion) -> str:
    """Return why accelerations are unknown; empty if they are known."""
    gaps, window = np.diff(motion.times), robot.thresholds.window
    gap = float(np.median(gaps)) if len(gaps) else 0.0
    if gap <= window:
        return ""
    return (
        f"its samples are {gap:.3g} s apart, too far for accelerations (the limit is "
        f"{window:.3g} s)"
    )


def _contact_forces(rule: Rule, measured: Measured) -> Iterator[Finding | None]:
    """Find where no contact can give what a motion needs, by cause."""
    found = measured.once(forces)
    share = np.where(np.isnan(found.missing_share), 0.0, found.missing_share)
    weight = float(measured.robot.masses.total) * GRAVITY
    bound = rule.lowest(measured.robot.thresholds) * weight
    with np.errstate(invalid="ignore"):
        along = np.hypot(found.needed[:, 0], found.needed[:, 1])
        pulls = found.needed[:, 2] < -bound
        slips = along - found.available_friction * found.needed[:, 2] > bound
    is_left = np.ones(len(share), dtype=bool)
    causes = (~found.in_contact, _in_air), (pulls, _pull), (slips, _slip)
    for mask, write in (*causes, (is_left, _moment)):
        sizes = np.where(mask & is_left, share, 0.0)
        is_left &= ~mask
        at = int(sizes.argmax())
        text = f"{write(measured, found, at)}{{when}}: {_size(found, at)}"
        points = found.center_of_mass
        yield rule.compared(measured, (), sizes, text, points=points)


def _size(found: ContactForces, at: int) -> str:
    """Write what is missing."""
    force, moment = np.linalg.norm(found.missing[at].reshape(2, 3), axis=1)
    return (
        f"{force:.3g} N and {moment:.3g} N m are missing, {{worst:.2f}} of the weight"
    )


def _in_air(measured: Measured, found: ContactForces, at: int) -> str:
    """Describe a robot in the air that does not fall."""
    assert measured.heights is not None
    low, up = int(measured.heights[at].argmin()), found.needed[at, 2]
    link, height = measured.ground_links[low], measured.heights[at, low]
    need = f"needs {up:.3g} N upwards" if up > 0.0 else "falls faster than gravity"
    return (
        f"the robot {need} while {link}, its lowest link, is {height:.3g} m in the air"
    )


def _pull(measured: Measured, found: ContactForces, at: int) -> str:
    """Describe a floor that would have to pull."""
    return f"the floor would have to pull with {-found.needed[at, 2]:.3g} N"


def _slip(measured: Measured, found: ContactForces, at: int) -> str:
    """Describe too little friction."""
    return (
        f"friction of {found.friction[at]:.2g} is needed and "
        f"{found.available_friction[at]:.2g} is available"
    )


def _moment(measured: Measured, found: ContactForces, at: int) -> str:
    """Describe where the floor would have to push."""
    assert measured.wrench is not None
    support, weight = measured.support[at], float(measured.robot.masses.total) * GRAVITY
    floor = float(np.broadcast_to(measured.floor, len(measured.times))[at])
    x, y = zero_moment_point(measured.wrench[at], weight, floor)
    outside = -support_margin(support_polygon(support), x, y) if len(support) else 0.0
    if not (np.isfinite(x) and outside > 0.0):
        return "no forces at the contacts give this motion"
    away = np.array([x, y, floor]) - [*support.mean(axis=0), floor]
    ahead = rotate(conjugate(measured.base_poses()[at, 3:]), away)
    side = SIDES[int(np.round(np.arctan2(ahead[1], ahead[0]) / (np.pi / 2.0))) % 4]
    return f"the zero-moment point is {outside:.3g} m {side} the support polygon"


def _efforts(rule: Rule, measured: Measured) -> Iterator[Finding | None]:
    """Compare efforts with their limits."""
    assert measured.efforts is not None
    joints, efforts = measured.robot.joints, measured.efforts
    if not measured.robot.is_fixed:
        efforts = measured.once(forces).efforts
    bounds = np.array([joint.effort for joint in joints])
    is_known = measured.once(near_jumps).is_known
    known = np.where(is_known[:, np.newaxis], efforts, np.nan)
    words = [units(joint)[1] for joint in joints]
    return fractions(rule, measured, joints, known, bounds, words)


def force_figures(measured: Measured) -> dict[str, float]:
    """Compute the largest missing share of the weight, and the friction needed."""
    found = measured.once(forces)
    figures = {}
    if np.isfinite(found.missing_share).any():
        figures["largest_missing_wrench"] = float(np.nanmax(found.missing_share))
        bound = CONTACT_FORCES.lowest(measured.robot.thresholds)
        is_missing = CONTACT_FORCES.exceeds(found.missing_share, bound)
        figures["infeasible_share"] = time_share(measured.times, is_missing)
    friction = np.where(found.in_contact, found.friction, np.nan)
    if np.isfinite(friction).any():
        figures["needed_friction"] = float(np.nanmax(friction))
    return figures


CONTACT_FORCES = Rule(
    name="contact_forces",
    about="motions that no [contact forces](contact_forces.md) can produce",
    level=Level(0.1, 0.3),
    limit="fraction of the weight that no contact can give",
    unit="of the weight",
    find=_contact_forces,
    needs=("neighbours", "forces"),
    requires="base",
    skip=too_slow,
    is_live=False,  # at rest, center_of_mass knows
)
EFFORT = Rule(
    name="effort",
    about="efforts beyond the limits of the URDF, with the most favourable contact "
    "forces",
    level=Level(0.9, 1.0),
    limit="fraction of the URDF's limit",
    unit="of the limit",
    find=_efforts,
    needs=("efforts",),
    requires="base or `--fixed-base`",
    skip=lambda robot, motion: "" if robot.is_fixed else too_slow(robot, motion),
)
