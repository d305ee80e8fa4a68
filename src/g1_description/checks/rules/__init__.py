"""The rules of all checks, a module per family."""

from __future__ import annotations

from g1_description.checks.rules.forces import CONTACT_FORCES, EFFORT
from g1_description.checks.rules.grasp import GRASP
from g1_description.checks.rules.ground import (
    CENTER_OF_MASS,
    DRIFT,
    FLOATING,
    PENETRATION,
    SKATING,
)
from g1_description.checks.rules.jumps import BASE_JUMP, JUMP
from g1_description.checks.rules.limits import (
    ACCELERATION,
    JERK,
    POSITION,
    VELOCITY,
)
from g1_description.checks.rules.obstacles import CLEARANCE, COLLISION
from g1_description.checks.rules.physics import FALL, SATURATION, TRACKING
from g1_description.checks.rules.self_collision import SELF_COLLISION

RULES = (
    POSITION,
    VELOCITY,
    ACCELERATION,
    JERK,
    EFFORT,
    JUMP,
    BASE_JUMP,
    SELF_COLLISION,
    COLLISION,
    CLEARANCE,
    GRASP,
    PENETRATION,
    FLOATING,
    SKATING,
    DRIFT,
    CENTER_OF_MASS,
    CONTACT_FORCES,
    TRACKING,
    SATURATION,
    FALL,
)
"""In the order of reports."""
