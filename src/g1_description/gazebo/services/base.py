"""What all services share: status messages, and checks of the numbers they take."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable
from concurrent.futures import Future
from dataclasses import dataclass

import numpy as np

from g1_description.bounds import MAX_VALUE
from g1_description.errors import InvalidValueError
from g1_description.robot.description import clamped_to_limits
from g1_description.robot.rotation import normalized
from g1_description.ros.conversions import pose_to_array, twist_to_array
from g1_description.sim.forces import Span
from g1_description.sim.model import Model, Report
from g1_description.sim.world import World
from g1_description.text import listed


@dataclass
class _Waiting:
    """Somebody who waits for steps to pass."""

    answer: Future
    steps: int
    respond: Callable
    """Makes the response: takes success and a sentence."""

    done: int = 0


class Stepper:
    """Requests for steps, served one after the other."""

    def __init__(self, paused: bool) -> None:
        """Begin.

        Args:
            paused: Whether time stands still at first.
        """
        self.paused = paused
        self._waiting: deque[_Waiting] = deque()

    @property
    def is_stepping(self) -> bool:
        """Whether steps were requested that have not passed yet."""
        return bool(self._waiting)

    @property
    def is_last_step(self) -> bool:
        """Whether the next step is the last of a request."""
        return bool(self._waiting) and self._waiting[0].steps == (
            self._waiting[0].done + 1
        )

    def request(self, steps: int, respond: Callable) -> Future:
        """Request steps.

        Args:
            steps: How many, at least one.
            respond: Makes the response when they have passed or will not: takes
                success and a sentence.

        Returns:
            The response to come.
        """
        answer: Future = Future()
        self._waiting.append(_Waiting(answer, steps, respond))
        return answer

    def count(self) -> None:
        """Note that a step has passed, and answer who has waited for it."""
        if not self._waiting:
            return
        first = self._waiting[0]
        first.done += 1
        if first.done == first.steps:
            self._waiting.popleft()
            first.answer.set_result(first.respond(True, f"{first.steps} steps done"))

    def end(self, reason: str) -> None:
        """Answer those who wait for steps that will not pass."""
        while self._waiting:
            one = self._waiting.popleft()
            outcome = f"ended by {reason} after {one.done} of {one.steps} steps"
            one.answer.set_result(one.respond(False, outcome))

    def cancel(self) -> None:
        """Let nobody wait any more, without a response."""
        while self._waiting:
            self._waiting.popleft().answer.cancel()


_SCOPE = "did you forget to scope the link by model name?"
LINK_NOT_FOUND = f"link not found, {_SCOPE}"
FRAME_NOT_FOUND = f"reference reference_frame not found, {_SCOPE}"


class StatusMessages:
    """Composes Gazebo's status messages, with details that Gazebo does not give."""

    def __init__(self, strict: bool = False) -> None:
        """Choose how much detail is given.

        Args:
            strict: Whether to give Gazebo's messages alone.
        """
        self._strict = strict

    def compose(self, message: str, details: Iterable[str] = ()) -> str:
        """Append details to Gazebo's message, each after "; "."""
        added = [] if self._strict else [detail for detail in details if detail]
        return "; ".join([message, *added]) if message else "; ".join(added)


class Services:
    """Some of the services of a world."""

    def __init__(self, world: World, messages: StatusMessages) -> None:
        """Serve a world.

        Args:
            world: What the services act on.
            messages: Composes their status messages.
        """
        self._world = world
        self._messages = messages

    def _no_effect(self, detail: str) -> str:
        """Say that something has no effect where nothing moves by itself."""
        return "" if self._world.is_dynamic else f"{detail}, physics is kinematic"


class SteppedServices(Services):
    """Services that depend on whether time runs, or on steps."""

    def __init__(
        self, world: World, messages: StatusMessages, stepper: Stepper
    ) -> None:
        """Serve a world.

        Args:
            world: What the services act on.
            messages: Composes their status messages.
            stepper: Whether time runs, and the steps that were requested.
        """
        super().__init__(world, messages)
        self._stepper = stepper


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
    """Check that numbers are finite and within bounds.

    Raises:
        InvalidValueError: If one is NaN, infinite or beyond ``MAX_VALUE``.
    """
    array = np.array(numbers, dtype=float)
    if not (np.abs(array) <= MAX_VALUE).all():
        raise InvalidValueError(
            f"the {what} {array.tolist()} has a number that is not within "
            f"+-{MAX_VALUE:g}"
        )
    return array


def remarks(model: Model, report: Report) -> list[str]:
    """Say which joints a model does not have, and which positions were clamped."""
    details = []
    if report.unknown:
        names = listed(report.unknown)
        details.append(f"ignored, no movable joint of {model.name}: {names}")
    if report.clamped:
        joints = model.assembly.description.movable_joints
        details.append(clamped_to_limits(report.clamped, joints))
    return details


def time_span(start_time, duration, now_ns: int) -> Span:
    """Compute from when to when something acts, as Gazebo does.

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
