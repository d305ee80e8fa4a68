"""Common to all services: the simulation, refusals, and checks of numbers.

A service is a function of the simulation and the request. It returns the response, or
the status message of a success, and raises an error for a failure.
"""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Callable
from concurrent.futures import Future

import numpy as np
import rospy

from g1_description.bounds import MAX_VALUE
from g1_description.errors import (
    G1DescriptionError,
    InvalidValueError,
    UnknownNameError,
)
from g1_description.robot.description import clamped_to_limits
from g1_description.robot.rotation import normalized
from g1_description.ros.conversions import pose_to_array
from g1_description.ros.log import ThrottledLog
from g1_description.sim.forces import Span
from g1_description.sim.model import Model, Report
from g1_description.sim.world import World
from g1_description.text import listed

_SCOPE = "did you forget to scope the link by model name?"
LINK_NOT_FOUND = f"link not found, {_SCOPE}"
FRAME_NOT_FOUND = f"reference reference_frame not found, {_SCOPE}"


class RefusalError(G1DescriptionError):
    """Gazebo's status message of a failed request, and our details."""


class Simulation:
    """A world, the steps requested of it, and the style of status messages."""

    def __init__(self, world: World, paused: bool = False, strict: bool = False):
        """Take a world.

        Args:
            world: The world.
            paused: Whether time is paused at the start.
            strict: Whether status messages are exactly Gazebo's, without our details.
        """
        self.world = world
        self.stepper = Stepper(paused)
        self.log = ThrottledLog()
        self.state_calls: Counter = Counter()
        """Calls of get_model_state by model."""
        self._strict = strict

    def message(self, message: str, *details: str) -> str:
        """Append details to Gazebo's message, each after "; "."""
        added = [] if self._strict else filter(None, details)
        return "; ".join([*filter(None, [message]), *added])

    def no_effect(self, detail: str) -> str:
        """Append that physics is kinematic to a detail; empty in dynamic physics."""
        return "" if self.world.is_dynamic else f"{detail}, physics is kinematic"


class Stepper:
    """Queue of requests for steps."""

    def __init__(self, paused: bool) -> None:
        self.paused = paused
        self._done = 0  # of the first request
        self._waiting: deque[tuple[Future, int, Callable]] = deque()

    @property
    def is_stepping(self) -> bool:
        """Whether requested steps are pending."""
        return bool(self._waiting)

    @property
    def is_last_step(self) -> bool:
        """Whether the next step is the last of a request."""
        return bool(self._waiting) and self._waiting[0][1] == self._done + 1

    def request(self, steps: int, respond: Callable) -> Future:
        """Request steps.

        Args:
            steps: Number of steps, at least one.
            respond: Makes the response from success and a sentence.

        Returns:
            The future response.
        """
        answer: Future = Future()
        self._waiting.append((answer, steps, respond))
        return answer

    def count(self) -> None:
        """Count a step, and answer the request that it completes."""
        if not self._waiting:
            return
        self._done += 1
        answer, steps, respond = self._waiting[0]
        if self._done == steps:
            self._waiting.popleft()
            self._done = 0
            answer.set_result(respond(True, f"{steps} steps done"))

    def end(self, reason: str) -> None:
        """Abort all requests with an answer."""
        while self._waiting:
            answer, steps, respond = self._waiting.popleft()
            outcome = f"ended by {reason} after {self._done} of {steps} steps"
            self._done = 0
            answer.set_result(respond(False, outcome))

    def cancel(self) -> None:
        """Cancel all requests without an answer."""
        while self._waiting:
            self._waiting.popleft()[0].cancel()


def make_callback(simulation: Simulation, kind, answer):
    """Make the callback of a service.

    Args:
        simulation: The world and its services' state.
        kind: The service's type.
        answer: The function that answers.
    """
    response = kind._response_class

    def respond(request):
        try:
            result = answer(simulation, request)
        except RefusalError as refusal:
            message = simulation.message(*refusal.args)
        except G1DescriptionError as error:
            message = f"{kind.__name__}: refused, {error}"
        else:
            if isinstance(result, str):
                return response(success=True, status_message=result)
            return response() if result is None else result
        return response(success=False, status_message=message)

    return respond


def found(find: Callable, name: str, message: str, log: str = ""):
    """Find an entity by its name.

    Args:
        find: The function that finds it.
        name: The name.
        message: Status message if there is none.
        log: Message to log then.

    Raises:
        RefusalError: If there is none.
    """
    try:
        return find(name)
    except UnknownNameError:
        if log:
            rospy.logerr("%s", log)
        raise RefusalError(message) from None


def checked_pose(message) -> np.ndarray:
    """Read a pose as Gazebo does: a zero quaternion is the identity.

    Raises:
        InvalidValueError: If a number is NaN, infinite or too large.
    """
    pose = checked("pose", pose_to_array(message))
    pose[3:] = normalized(pose[3:])
    return pose


def checked(label: str, numbers) -> np.ndarray:
    """Check that numbers are finite and within bounds.

    Raises:
        InvalidValueError: If one is NaN, infinite or beyond ``MAX_VALUE``.
    """
    array = np.array(numbers, dtype=float)
    if not (np.abs(array) <= MAX_VALUE).all():
        raise InvalidValueError(
            f"all numbers of {label} must be within +-{MAX_VALUE:g} (got "
            f"{array.tolist()})"
        )
    return array


def remarks(model: Model, report: Report) -> list[str]:
    """Describe the ignored and the clamped joints of a command."""
    details = []
    if report.unknown:
        names = listed(report.unknown)
        details.append(f"ignored, no movable joint of {model.name}: {names}")
    if report.clamped:
        joints = model.assembly.description.movable_joints
        details.append(clamped_to_limits(report.clamped, joints))
    return details


def time_span(start_time, duration, now_ns: int) -> Span:
    """Compute start and end of an effort or wrench, as Gazebo does.

    Args:
        start_time: Its start; the past means now.
        duration: Its duration; negative means for ever.
        now_ns: The current time in [ns].
    """
    start = max(start_time.to_nsec(), now_ns)
    lasting = duration.to_nsec()
    return Span(start, None if lasting < 0 else start + lasting)
