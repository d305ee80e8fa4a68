"""What a robot does, state by state.

Base and joints of one sample are of one state: the base of the simulator's message, the
joints of the bridge's with the same stamp. Neither joint_states and TF, which is
throttled, nor two topics at their newest would do.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import rospy
from sensor_msgs.msg import JointState

from g1_description.bridge.estimator import JointStateEstimator, Observation
from g1_description.bridge.state_source import RisingStamps, StateSource
from g1_description.cli.recorded_file import Room
from g1_description.errors import G1DescriptionError, MotionError, UnknownNameError
from g1_description.motion.trajectory import Trajectory
from g1_description.robot.assembly import SCOPE
from g1_description.robot.description import Description
from g1_description.ros.log import ThrottledLog
from g1_description.ros.waiting import BUFFER
from g1_description.ros.wire import LinkStatesArrays
from g1_description.text import listed


class SeveralModelsError(UnknownNameError):
    """Several models may be meant."""


def find_model(links: Sequence[str], robot: Description, namespace: str) -> str:
    """Find the model whose links are the robot's.

    Args:
        links: Scoped names of all links of the simulator.
        robot: The robot.
        namespace: Namespace of its topics; of several models the one of that name is
            taken.

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
    error, what = UnknownNameError, f"only {listed(counts) or 'nothing'}"
    if found:
        error = SeveralModelsError
        what = f"several such, {listed(found)}: --model names one"
    raise error(
        f"The simulator has no single model with links of '{robot.name}' but {what}."
    )


EARLY = 1000
"""A state this much before it is due counts, in [ns]: periods are rounded."""

SAME_JOINTS = 1e-6
"""Largest difference in [rad] or [m], but for whole turns, between the same joints
measured here and by the bridge; joints that are farther apart are another robot's."""

MAX_CONNECT_TIME = 2_000_000_000
"""Simulated time in [ns] in which a bridge that runs is connected to; what is recorded
before a bridge that comes later counts."""

MAX_RECENT = 5000
"""Joint states kept until the simulator's state with their stamp comes."""


@dataclass
class _Sample:
    """A state that was recorded."""

    stamp: int
    """In [ns]."""

    positions: np.ndarray
    velocities: np.ndarray
    base_pose: np.ndarray | None


class Recorder:
    """Follows a robot of the simulator.

    Subscribes: <gazebo>/world_state or <gazebo>/link_states, joint_states
        (sensor_msgs/JointState)
    """

    def __init__(
        self,
        robot: Description,
        names: tuple[str, str, str],
        rate: float,
        seconds: float | None,
        find_room: Callable[[Sequence[str], bool], Room],
    ) -> None:
        """Subscribe; the first state that comes is the first sample.

        Args:
            robot: The robot.
            names: Namespace of the simulator; name of the robot's model, empty where it
                is to be found; namespace of its topics.
            rate: Samples per second of simulated time; 0: every state.
            seconds: How long, in [s] of simulated time; None: until it is closed.
            find_room: Finds how much can be saved, by the names of the joints and
                whether there is a base.
        """
        gazebo, self._model, self._namespace = names
        self._robot, self._rate, self._seconds = robot, rate, seconds
        self._find_room, self._room = find_room, Room(0, False)
        self._estimator: JointStateEstimator | None = None
        self._stamps = RisingStamps()
        self._due = 0
        self._names: tuple[str, ...] = ()
        self._samples: list[_Sample] = []
        self._waiting: dict[int, _Sample] = {}
        self._recent: dict[int, JointState] = {}
        self._is_matched = False
        self._lock = threading.Lock()
        self.heard = time.monotonic()
        """When the last state came, on the monotonic clock."""
        self.problem: UnknownNameError | None = None
        """Why the last state was of no use before the first sample."""
        self.refusal: G1DescriptionError | None = None
        """Why no state will be of use."""
        self.notes: list[str] = []
        self.is_over = False
        self._left_out = 0
        prefix = f"/{self._namespace}/" if self._namespace else ""
        self._joint_states = rospy.Subscriber(
            f"{prefix}joint_states",
            JointState,
            self._on_joint_states,
            queue_size=None,
            buff_size=BUFFER,
            tcp_nodelay=True,
        )
        self._source = StateSource(gazebo, 0.0, self._on_states, ThrottledLog())
        self._source.start()

    @property
    def n_samples(self) -> int:
        """Number of samples until now."""
        return len(self._samples)

    @property
    def lacks_joints(self) -> bool:
        """Whether joint states of some samples may still come."""
        return bool(self._waiting and self._joint_states.get_num_connections())

    @property
    def is_connected(self) -> bool:
        """Whether there is a simulator."""
        return self._source.is_connected

    @property
    def hears_bridge(self) -> bool:
        """Whether someone publishes joint states in the robot's namespace."""
        return self._joint_states.get_num_connections() > 0

    @property
    def topic(self) -> str:
        """Name of the topic that the states are from."""
        return self._source.topic

    def keep_up(self) -> None:
        """Do what no message triggers; to be called several times a second."""
        self._source.keep_up()

    def close(self) -> None:
        """End the recording."""
        self.is_over = True
        self._joint_states.unregister()

    def _on_states(self, stamp: int, states: LinkStatesArrays) -> None:
        """Take a state."""
        self.heard = time.monotonic()
        rising = self._stamps.next(stamp, rospy.Time.now().to_nsec())
        if self.is_over or rising is None:
            return
        stamp, went_back = rising
        if went_back and self._samples:
            self.end("time went back")
            return
        if self._estimator is None:
            try:
                self._model = self._model or find_model(
                    states.names, self._robot, self._namespace
                )
            except SeveralModelsError as error:
                self._refuse(error)
                return
            except UnknownNameError as error:
                self.problem = error
                return
            self._estimator = JointStateEstimator({self._model: self._robot})
        (seen,) = self._estimator.update(*states, 1e-9 * stamp)
        if stamp >= self._due - EARLY:
            self._keep(stamp, seen)

    def end(self, why: str) -> None:
        """End the recording early, and note why."""
        seconds = (self._samples[-1].stamp - self._samples[0].stamp) / 1e9
        self.notes.append(f"{why} after {seconds:.3f} s: it ends there.")
        self.is_over = True

    def _refuse(self, error: G1DescriptionError) -> None:
        """Record nothing."""
        self.refusal = error
        self.is_over = True

    def _keep(self, stamp: int, seen: Observation) -> None:
        """Record a state."""
        if not seen.is_present:
            self.problem = UnknownNameError(
                f"The simulator has no model '{self._model}' with links of "
                f"'{self._robot.name}'."
            )
            return
        with self._lock:
            if not self._samples:
                try:
                    self._room = self._find_room(seen.names, seen.base_pose is not None)
                except MotionError as error:
                    self._refuse(error)
                    return
                self._names = seen.names
            elif seen.names != self._names or (
                (seen.base_pose is None) != (self._samples[0].base_pose is None)
            ):
                self._left_out += 1
                return
            if self._is_full(stamp):
                self.end("the file can hold no more")
                return
            base = None if seen.base_pose is None else seen.base_pose.copy()
            sample = _Sample(stamp, seen.position.copy(), seen.velocity.copy(), base)
            self._samples.append(sample)
            self._waiting[stamp] = sample
            published = self._recent.pop(stamp, None)
            if published is not None:
                self._match(published)
            self._plan_next(stamp)

    def _is_full(self, stamp: int) -> bool:
        """Return whether another sample is more than can be saved."""
        count = len(self._samples) + 1
        if self._samples and self._rate and self._room.is_even:
            count = int((stamp - self._samples[0].stamp) * self._rate / 1e9) + 2
        return count > self._room.samples

    def _plan_next(self, stamp: int) -> None:
        """Find when the next sample is due."""
        elapsed = stamp - self._samples[0].stamp
        if self._rate:
            number = int((elapsed + EARLY) * self._rate / 1e9) + 1
            self._due = self._samples[0].stamp + round(number * 1e9 / self._rate)
        if self._seconds is not None and elapsed + EARLY >= self._seconds * 1e9:
            self.is_over = True

    def _on_joint_states(self, message: JointState) -> None:
        """Take what the bridge publishes of a state."""
        with self._lock:
            if not self._match(message):
                self._recent[message.header.stamp.to_nsec()] = message
                while len(self._recent) > MAX_RECENT:
                    del self._recent[next(iter(self._recent))]

    def _match(self, message: JointState) -> bool:
        """Put the joints that were published into the sample with their stamp.

        They are those that were measured, with the turns that the bridge has counted;
        others are of another robot, and left out.
        """
        sample = self._waiting.pop(message.header.stamp.to_nsec(), None)
        if sample is None:
            return False
        if tuple(message.name) == self._names:
            positions = np.array(message.position)
            # The bridge may have counted turns before.
            apart = positions - sample.positions
            apart -= 2.0 * np.pi * np.round(apart / (2.0 * np.pi))
            if np.abs(apart).max(initial=0.0) < SAME_JOINTS:
                sample.positions = positions
                sample.velocities = np.array(message.velocity)
                self._begin_at(sample)
        return True

    def _begin_at(self, sample: _Sample) -> None:
        """Leave out the first instants, in which the bridge was not heard yet.

        Their joints may be whole turns from those that follow.
        """
        early = sample.stamp - self._samples[0].stamp
        is_connecting = early < MAX_CONNECT_TIME and not self.is_over
        if is_connecting and not self._is_matched:
            while self._samples[0] is not sample:
                self._waiting.pop(self._samples.pop(0).stamp, None)
        self._is_matched = True

    def trajectory(self) -> tuple[Trajectory, int]:
        """Return what was recorded, from zero on, and the first stamp in [ns]."""
        with self._lock:
            if self._left_out:
                self.notes.append(
                    f"{self._left_out} states without all links are left out."
                )
            samples = self._samples
            begin = samples[0].stamp
            bases = [s.base_pose for s in samples if s.base_pose is not None]
            return Trajectory(
                np.array([sample.stamp - begin for sample in samples]) / 1e9,
                self._names,
                np.array([sample.positions for sample in samples]),
                np.array([sample.velocities for sample in samples]),
                np.array(bases) if bases else None,
            ), begin
