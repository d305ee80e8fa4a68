"""What is odd about the limits of a robot."""

from __future__ import annotations

from g1_description.core.errors import ThresholdError
from g1_description.core.robot.description import Description
from g1_description.core.text import listed, similar_first

from .thresholds import BOUNDS, Thresholds


def check_bounds(thresholds: Thresholds, description: Description) -> None:
    """Check that bounds are of joints that a robot has.

    Raises:
        ThresholdError: If it has no such joint.
    """
    own = [joint.name for joint in description.movable_joints]
    for name in BOUNDS:
        for joint in getattr(thresholds, name).joints:
            if joint not in own:
                raise ThresholdError(
                    f"{name} names {joint}; {description.name} has "
                    f"{listed(similar_first(joint, own))}."
                )


def zero_limits(description: Description) -> tuple[str, ...]:
    """Tell of limits of zero, which exporters write where they know none."""
    notes = []
    for what in ("velocity", "effort"):
        joints = description.movable_joints
        names = [joint.name for joint in joints if getattr(joint, what) == 0.0]
        if names:
            notes.append(
                f"{description.name} limits the {what} of {listed(names)} to 0: it is "
                "not judged."
            )
    return tuple(notes)
