"""What all services share: what they say, and the numbers they take."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from g1_description.core.errors import LARGEST, InvalidValueError
from g1_description.core.rotation import normalized
from g1_description.ros.wire.conversions import pose_to_array, twist_to_array
from g1_description.sim.forces import Span
from g1_description.sim.model import Report
from g1_description.sim.world import World

_SCOPE = "did you forget to scope the link by model name?"
LINK_NOT_FOUND = f"link not found, {_SCOPE}"
FRAME_NOT_FOUND = f"reference reference_frame not found, {_SCOPE}"


class Wording:
    """Gazebo's own words, and what we add where it would be silent."""

    def __init__(self, strict: bool = False) -> None:
        """Choose how much is said.

        Args:
            strict: Whether to give Gazebo's bare words.
        """
        self._strict = strict

    def say(self, words: str, clauses: Iterable[str] = ()) -> str:
        """Put what we add behind Gazebo's words, after "; "."""
        added = [] if self._strict else [clause for clause in clauses if clause]
        return "; ".join([words, *added]) if words else "; ".join(added)


class Services:
    """Some of the services of a world."""

    def __init__(self, world: World, wording: Wording) -> None:
        """Serve a world.

        Args:
            world: What the services act on.
            wording: How much they say.
        """
        self._world = world
        self._wording = wording

    def _in_vain(self, clause: str) -> str:
        """Tell what has no effect where nothing moves by itself."""
        return "" if self._world.is_dynamic else f"{clause}, physics is kinematic"


def checked_pose(message) -> np.ndarray:
    """Read a pose as Gazebo does: a zero quaternion is the identity.

    Raises:
        InvalidValueError: If a number is NaN, infinite or too large.
    """
    pose = checked("pose", pose_to_array(message))
    pose[3:] = normalized(pose[3:])
    return pose


def checked_twist(message) -> np.ndarray:
    """Read a twist.

    Raises:
        InvalidValueError: If a number is NaN, infinite or too large.
    """
    return checked("twist", twist_to_array(message))


def checked(what: str, numbers) -> np.ndarray:
    """Check that numbers are some that a model can have.

    Raises:
        InvalidValueError: If one is NaN, infinite or beyond ``LARGEST``.
    """
    array = np.array(numbers, dtype=float)
    if not (np.abs(array) <= LARGEST).all():
        raise InvalidValueError(
            f"the {what} {array.tolist()} has a number that is not within +-{LARGEST:g}"
        )
    return array


def clamped(report: Report) -> str:
    """Tell which positions were clamped; empty if none was."""
    values = [f"{name} to {value!r}" for name, value in report.clamped.items()]
    return f"clamped to the limits: {', '.join(values)}" if values else ""


def time_span(start_time, duration, now_ns: int) -> Span:
    """Tell from when to when something acts, as Gazebo takes it.

    Args:
        start_time: When it shall begin; the past means now.
        duration: How long it shall act; negative means for ever.
        now_ns: The time now, in [ns].

    Returns:
        The span.
    """
    start = max(start_time.to_nsec(), now_ns)
    lasting = duration.to_nsec()
    return Span(start, None if lasting < 0 else start + lasting)
