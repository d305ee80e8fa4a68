"""Messages of configurations to what checks take, and verdicts to messages."""

from __future__ import annotations

from collections.abc import Sequence

from geometry_msgs.msg import Point
from sensor_msgs.msg import JointState

from g1_description.core.checks.verdict import Finding, Verdict
from g1_description.core.errors import InvalidValueError
from g1_description.core.text import listed
from g1_description.msg import Finding as FindingMessage


def positions_of(message: JointState) -> dict[str, float]:
    """Read the positions of joint states, by joint.

    Raises:
        InvalidValueError: If there is not one for each name, or a name comes twice.
    """
    return _by_name(message, "position", message.position)


def velocities_of(message: JointState) -> dict[str, float]:
    """Read the velocities of joint states, by joint; empty where there are none.

    Raises:
        InvalidValueError: If there is not one for each name.
    """
    if not message.velocity:
        return {}
    return _by_name(message, "velocity", message.velocity)


def _by_name(
    message: JointState, what: str, numbers: Sequence[float]
) -> dict[str, float]:
    """Read the numbers of joint states."""
    names = message.name
    if len(names) != len(numbers):
        raise InvalidValueError(
            f"joint_state has {len(names)} names, and its {what} {len(numbers)} "
            "numbers; there must be as many."
        )
    found = dict(zip(names, numbers))
    if len(found) != len(names):
        twice = listed(name for name in found if names.count(name) > 1)
        raise InvalidValueError(f"joint_state names joints twice: {twice}.")
    return found


def finding_message(finding: Finding) -> FindingMessage:
    """Convert what was found."""
    return FindingMessage(
        finding.check,
        finding.severity,
        list(finding.subject),
        finding.worst,
        finding.bound,
        finding.unit,
        finding.first_time,
        finding.worst_time,
        finding.share,
        [Point(*point) for point in finding.points],
        finding.text,
    )


def skipped_lines(verdict: Verdict) -> list[str]:
    """List the checks that were not made, each with the reason."""
    return [f"{name}: {reason}" for name, reason in verdict.skipped.items()]
