"""Contact forces that a motion needs, and efforts of joints with these."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from g1_description.checks.contact_forces import (
    ContactForces,
    contact_forces,
    reach,
)
from g1_description.checks.intervals import time_share
from g1_description.checks.measured import CheckedRobot, Measured
from g1_description.checks.rule import Rule, units
from g1_description.checks.rules.jumps import near_jumps
from g1_description.checks.rules.limits import fractions
from g1_description.checks.support import (
    LEAST_FORCE,
    nearest_point,
    support_margin,
    support_polygon,
    zero_moment_point,
)
from g1_description.checks.thresholds import Level
from g1_description.checks.verdict import Finding
from g1_description.motion.motion import SNAP, Motion
from g1_description.robot.rotation import rotate

UPRIGHT = 0.5
"""Least length along the floor of the forward axis of an upright robot's base."""

SIDES = ("in front of", "to the left of", "behind", "to the right of")


def forces(measured: Measured) -> ContactForces:
    """Find the forces that a motion needs; call it by ``measured.once``."""
    return contact_forces(measured, measured.once(near_jumps).is_known)


def unknown_forces(robot: CheckedRobot, motion: Motion) -> str:
    """Return why contact forces are unknown; empty if they are known."""
    return robot.lacks("forces", motion) or unknown_accelerations(robot, motion)


def unknown_accelerations(robot: CheckedRobot, motion: Motion) -> str:
    """Return why accelerations are unknown; empty if they are known."""
    gaps, window = np.diff(motion.times), robot.thresholds.window
    gap = float(np.median(gaps)) if len(gaps) else 0.0
    if gap > window + SNAP:
        return (
            f"its samples are {gap:.3g} s apart, too far for accelerations (the limit "
            f"is {window:.3g} s)"
        )
    if len(gaps) and motion.duration < 2.0 * window:
        return (
            f"it lasts {motion.duration:.3g} s; accelerations need {2 * window:.3g} s"
        )
    return ""


def _contact_forces(rule: Rule, measured: Measured) -> Iterator[Finding | None]:
    """Find where no contact can give what a motion needs, by cause."""
    found = measured.once(forces)
    share = np.where(np.isnan(found.missing_share), 0.0, found.missing_share)
    least = rule.lowest(measured.robot.thresholds)
    up, along = found.needed[:, 2], np.hypot(found.needed[:, 0], found.needed[:, 1])
    with np.errstate(invalid="ignore"):
        pulls = up < LEAST_FORCE * found.weight
        slips = along - found.available_friction * up > least * found.weight
    is_left = np.ones(len(share), dtype=bool)
    causes = (~found.in_contact, _in_air), (pulls, _pull), (slips, _slip)
    for mask, write in (*causes, (is_left, _moment)):
        sizes = np.where(mask & is_left, share, 0.0)
        is_left &= ~mask
        at = int(sizes.argmax())
        if rule.exceeds(sizes[at], least):
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
    """Describe a robot in the air that does not fall freely."""
    assert measured.heights is not None
    low, up = int(measured.heights[at].argmin()), found.needed[at, 2]
    link, height = measured.ground_links[low], measured.heights[at, low]
    need = f"needs {up:.3g} N upwards" if up > 0.0 else "falls faster than gravity"
    if abs(up) < LEAST_FORCE * found.weight[at]:
        need = "accelerates sideways or turns"
    return (
        f"the robot {need} while {link}, its lowest link, is {height:.3g} m in the air"
    )


def _pull(measured: Measured, found: ContactForces, at: int) -> str:
    """Describe a floor that would have to pull, or that carries next to nothing."""
    up, along = found.needed[at, 2], np.hypot(*found.needed[at, :2])
    if up < -LEAST_FORCE * found.weight[at]:
        return f"the floor would have to pull with {-up:.3g} N"
    return (
        f"{along:.3g} N along the floor are needed while the robot presses on it with "
        f"{max(up, 0.0):.3g} N"
    )


def _slip(measured: Measured, found: ContactForces, at: int) -> str:
    """Describe too little friction."""
    return (
        f"friction of {found.friction[at]:.2g} is needed and "
        f"{found.available_friction[at]:.2g} is available"
    )


def _moment(measured: Measured, found: ContactForces, at: int) -> str:
    """Describe where the floor would have to push."""
    assert measured.wrench is not None
    points, turning = found.contacts(at), found.missing[at, 3:]
    x, y = zero_moment_point(
        measured.wrench[at], float(found.weight[at]), float(points[:, 2].mean())
    )
    polygon = support_polygon(points[:, :2])
    outside = -support_margin(polygon, x, y)
    if np.isfinite(x) and outside > 0.0:
        away = np.array([x, y]) - nearest_point(polygon, x, y)
        where = side(measured.base_poses()[at, 3:], away, SIDES) or "outside"
        text = f"the zero-moment point is {outside:.3g} m {where} the support polygon"
        return text + _raised(measured, at)
    if abs(turning[2]) > np.hypot(*turning[:2]):
        return (
            f"{abs(found.needed[at, 5]):.3g} N m about the vertical are needed, more "
            "than friction gives"
        )
    return "no forces at the contacts give this motion"


def _raised(measured: Measured, at: int) -> str:
    """Name a link in contact that is too far above the others to carry anything."""
    assert measured.heights is not None
    assert measured.in_contact is not None
    heights = np.where(measured.in_contact[at], measured.heights[at], -np.inf)
    column, lowest = int(heights.argmax()), measured.heights[at].min()
    if heights[column] <= reach(lowest):
        return ""
    return f" without {measured.ground_links[column]}, {heights[column]:.3g} m up"


def side(base: np.ndarray, away: np.ndarray, names: Sequence[str]) -> str:
    """Name the side of a robot to which a direction along the floor points.

    Args:
        base: Rotation of the base, shape (4,).
        away: The direction, shape (2,).
        names: For forwards, left, backwards and right.

    Returns:
        A name; empty if the robot is not upright.
    """
    ahead = rotate(base, np.array([1.0, 0.0, 0.0]))[:2]
    if np.hypot(*ahead) < UPRIGHT:
        return ""
    turn = np.arctan2(away[1], away[0]) - np.arctan2(ahead[1], ahead[0])
    return names[int(np.round(turn / (np.pi / 2.0))) % 4]


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
    level=Level(0.06, 0.3),
    limit="fraction of the weight that no contact can give",
    unit="of the weight",
    find=_contact_forces,
    needs=("neighbours", "forces"),
    requires="base",
    skip=unknown_accelerations,
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
    skip=lambda robot, motion: (
        "" if robot.is_fixed else unknown_accelerations(robot, motion)
    ),
)
