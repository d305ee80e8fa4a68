"""Balance: centre of mass and zero-moment point outside the support polygon."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from g1_description.checks.measured import Measured
from g1_description.checks.rule import Rule
from g1_description.checks.rules.jumps import near_jumps
from g1_description.checks.thresholds import Level
from g1_description.checks.verdict import Finding

OUTSIDE = "{worst:.4g} m outside the support polygon{when}"


def _center_of_mass(rule: Rule, measured: Measured) -> Iterator[Finding | None]:
    """Find the centre of mass outside, while the robot is still."""
    balance = measured.balance
    assert balance is not None
    below = balance.center.copy()
    below[:, 2] = measured.robot.thresholds.floor_height
    sizes = np.where(balance.is_still, -balance.center_margin, np.nan)
    text = f"centre of mass {OUTSIDE}"
    yield rule.compared(measured, (), sizes, text, points=below)


def _zero_moment_point(rule: Rule, measured: Measured) -> Iterator[Finding | None]:
    """Find the zero-moment point outside, where accelerations are known."""
    assert measured.balance is not None
    is_known = measured.once(near_jumps).is_known
    sizes = np.where(is_known, -measured.balance.zmp_margin, np.nan)
    yield rule.compared(measured, (), sizes, f"zero-moment point {OUTSIDE}")


CENTER_OF_MASS = Rule(
    name="center_of_mass",
    about="the centre of mass outside the support polygon, while the robot is still",
    level=Level(None, 0.0),
    limit="m outside the support polygon, while still",
    unit="m",
    find=_center_of_mass,
    needs=("ground", "balance"),
    requires="base",
    only_at_rest=True,
)
ZERO_MOMENT_POINT = Rule(
    name="zero_moment_point",
    about="the zero-moment point outside the support polygon",
    level=Level(0.05, None),
    limit="m outside the support polygon",
    unit="m",
    find=_zero_moment_point,
    needs=("ground", "balance"),
    requires="base",
    is_live=False,  # equal to the centre of mass at rest
)
