"""Recording of robot states.

A bridge publishes them as ``robot_state``. Without a bridge they are measured from link
states. Joint states and TF are not enough: TF is throttled.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence

import numpy as np
import rospy
from rosgraph_msgs.msg import Clock

from g1_description.bridge.estimator import JointStateEstimator
from g1_description.bridge.recorded_file import Room
from g1_description.bridge.state_source import RisingStamps, StateSource
from g1_description.errors import (
    G1DescriptionError,
    InvalidValueError,
    MotionError,
    UnknownNameError,
)
from g1_description.motion.motion import Motion
from g1_description.msg import RobotState as RobotStateMessage
from g1_description.robot.assembly import SCOPE
from g1_description.robot.description import Description
from g1_description.robot.state import RobotState
from g1_description.ros.conversions import robot_state_from_message
from g1_description.ros.log import ThrottledLog
from g1_description.ros.waiting import BUFFER, NoAnswerError
from g1_description.ros.wire import LinkStatesArrays
from g1_description.text import listed

EARLY = 1000
"""Tolerance of the time at which a state is due, in [ns]: periods are rounded."""


class Recorder:
    """Collects states of a robot at a rate."""

    def __init__(
        self,
        rate: float,
        seconds: float | None,
        find_room: Callable[[Sequence[str], bool], Room],
    ) -> None:
        """Begin without states.

        Args:
            rate: Samples per second of simulated time; 0: every state.
            seconds: Duration in [s] of simulated time; None: until it is ended.
            find_room: Returns the capacity of the file, from the names of the joints
                and whether there is a base.
        """
        self._rate, self._seconds = rate, seconds
        self._find_room, self._room = find_room, Room(0, False)
        self._due = 0
        self._ignored = 0
        self._last = 0
        """Stamp of the last state that came, also of one that was not due, in [ns]."""
        self.states: list[RobotState] = []
        self.heard = time.monotonic()
        """Time of the last state on the monotonic clock, in [s]."""
        self.refusal: G1DescriptionError | None = None
        """Error after which no state can be recorded."""
        self.notes: list[str] = []
        self.is_over = False

    def take(self, state: RobotState) -> None:
        """Add a state; called from one thread at a time. Its arrays must not change."""
        self.heard = time.monotonic()
        if self.is_over:
            return
        if not self.states:
            try:
                has_base = state.base_pose is not None
                self._room = self._find_room(state.names, has_base)
            except MotionError as error:
                self.refuse(error)
                return
        elif state.stamp < self._last:
            self.end("time went back")
            return
        elif state.stamp == self._last:  # latched
            return
        self._last = state.stamp
        if state.stamp < self._due - EARLY:
            return
        if self.states and _parts(state) != _parts(self.states[0]):
            self._ignored += 1
        elif self._is_full(state.stamp):
            self.end("the file is full")
        else:
            self.states.append(state)
            self._plan_next(state.stamp)

    def end(self, why: str) -> None:
        """End the recording early, with a note."""
        seconds = (self.states[-1].stamp - self.states[0].stamp) / 1e9
        self.notes.append(f"the recording ends after {seconds:.3f} s: {why}.")
        self.is_over = True

    def refuse(self, error: G1DescriptionError) -> None:
        """Abort the recording."""
        self.refusal = error
        self.is_over = True

    def _is_full(self, stamp: int) -> bool:
        """Return whether another sample would exceed the capacity."""
        count = len(self.states) + 1
        if self.states and self._rate and self._room.is_even:
            count = int((stamp - self.states[0].stamp) * self._rate / 1e9) + 2
        return count > self._room.samples

    def _plan_next(self, stamp: int) -> None:
        """Find when the next sample is due."""
        begin = self.states[0].stamp
        elapsed = stamp - begin + EARLY
        if self._rate:
            number = int(elapsed * self._rate / 1e9) + 1
            self._due = begin + round(number * 1e9 / self._rate)
        if self._seconds is not None and elapsed >= self._seconds * 1e9:
            self.is_over = True

    def motion(self) -> tuple[Motion, int]:
        """Return the recorded motion, from time zero, and the first stamp in [ns]."""
        if self._ignored:
            self.notes.append(f"ignored {self._ignored} incomplete states.")
        states = self.states[:]  # a copy: states may still be added
        begin = states[0].stamp
        bases = [state.base_pose for state in states if state.base_pose is not None]
        velocities = [s.velocities for s in states if s.velocities is not None]
        return Motion(
            np.array([state.stamp - begin for state in states]) / 1e9,
            states[0].names,
            np.array([state.positions for state in states]),
            np.array(velocities) if velocities else None,
            np.array(bases) if bases else None,
        ), begin


def _parts(state: RobotState) -> tuple[object, ...]:
    """Return the joints of a state, and what it lacks."""
    return state.names, state.base_pose is None, state.velocities is None


class BridgeStates:
    """The states of a robot that a bridge publishes.

    Subscribes: robot_state (g1_description/RobotState), /clock
        (rosgraph_msgs/Clock)
    """

    def __init__(self, topic: str, recorder: Recorder) -> None:
        self._recorder = recorder
        # Published by the simulator, which may end before the bridge.
        self._clock = rospy.Subscriber("/clock", Clock)
        self._subscriber = rospy.Subscriber(
            topic,
            RobotStateMessage,
            self._on_state,
            queue_size=None,
            buff_size=BUFFER,
            tcp_nodelay=True,
        )
        self.topic = self._subscriber.resolved_name
        """Name of the topic of the states."""

    @property
    def is_connected(self) -> bool:
        """Whether a bridge and a simulator are running."""
        has_clock = self._clock.get_num_connections() > 0
        return self._subscriber.get_num_connections() > 0 and (
            has_clock or rospy.rostime.is_wallclock()
        )

    @property
    def problem(self) -> G1DescriptionError | None:
        """Why no state has arrived."""
        if self._subscriber.get_num_connections():
            return None
        return NoAnswerError(f"Nothing publishes {self.topic}; is the namespace right?")

    def keep_up(self) -> None:
        """Do nothing: messages trigger everything."""

    def close(self) -> None:
        """Unsubscribe."""
        self._subscriber.unregister()
        self._clock.unregister()

    def _on_state(self, message: RobotStateMessage) -> None:
        """Record a state."""
        try:
            self._recorder.take(robot_state_from_message(message))
        except InvalidValueError as error:
            self._recorder.refuse(error)


class SimulatorStates:
    """The states of a robot, measured from a simulator's link states.

    Without a model name, the only model with the robot's links is used, or of several
    the one with the name of the namespace.
    """

    def __init__(
        self,
        robot: Description,
        gazebo: str,
        model: str,
        namespace: str,
        recorder: Recorder,
    ) -> None:
        self._robot, self._model, self._recorder = robot, model, recorder
        self._namespace = namespace
        self._estimator: JointStateEstimator | None = None
        self._stamps = RisingStamps()
        self.problem: G1DescriptionError | None = None
        """Why the last state could not be used."""
        self._source = StateSource(gazebo, 0.0, self._on_states, ThrottledLog())
        self._source.start()

    @property
    def topic(self) -> str:
        """Name of the topic of the states."""
        return self._source.topic

    @property
    def is_connected(self) -> bool:
        """Whether a simulator is running."""
        return self._source.is_connected

    def keep_up(self) -> None:
        """Do periodic work; must be called several times per second."""
        self._source.keep_up()

    def close(self) -> None:
        """Do nothing: a finished recorder ignores states."""

    def _on_states(self, stamp: int, states: LinkStatesArrays, _: object) -> None:
        """Record a state."""
        rising = self._stamps.next(stamp, rospy.Time.now().to_nsec())
        if rising is None:
            return
        if self._estimator is None:
            try:
                self._model = self._model or find_model(
                    states.names, self._robot, self._namespace
                )
            except SeveralModelsError as error:
                self._recorder.refuse(error)
                return
            except UnknownNameError as error:
                self.problem = error
                return
            self._estimator = JointStateEstimator({self._model: self._robot})
        (state,) = self._estimator.update(*states, rising[0])
        if self._estimator.problems[0].is_present:
            self._recorder.take(state)
            return
        self.problem = UnknownNameError(
            f"The simulator has no model '{self._model}' with the links of "
            f"'{self._robot.name}'."
        )


class SeveralModelsError(UnknownNameError):
    """Several models match."""


def find_model(links: Sequence[str], robot: Description, namespace: str = "") -> str:
    """Find the model with the robot's links.

    Args:
        links: Scoped names of all links of the simulator.
        robot: The robot.
        namespace: Name of the one of several models that is meant.

    Returns:
        The model's name.

    Raises:
        SeveralModelsError: If there are several.
        UnknownNameError: If there is none.
    """
    own, counts = {*robot.link_names}, {}
    for name in links:
        model, _, link = name.rpartition(SCOPE)
        counts[model] = counts.get(model, 0) + (link in own)
    most = max(counts.values(), default=0)
    found = [model for model, count in counts.items() if count == most and most]
    if namespace in found:
        return namespace
    if len(found) == 1:
        return found[0]
    error, reason = UnknownNameError, f"its models: {listed(counts) or 'none'}"
    if found:
        error = SeveralModelsError
        reason = f"several match, {listed(found)}: choose one with --model"
    raise error(f"Cannot find the model of '{robot.name}' in the simulator; {reason}.")
