"""The topics that the simulator publishes after each step."""

from __future__ import annotations

import math
import struct
import time
from collections.abc import Callable, Iterator

from gazebo_msgs.msg import LinkStates, ModelStates, WorldState
from rosgraph_msgs.msg import Clock

from g1_description.gazebo.parameters import GazeboParameters
from g1_description.msg import MotorStates, SimulatorState, TrackingReport
from g1_description.ros.conversions import stamp_from_ns
from g1_description.ros.publisher import DirectPublisher
from g1_description.ros.wire import (
    LinkStatesEncoder,
    MotorArrays,
    Prepared,
    encode_motors,
    ready,
)
from g1_description.sim.motions import MotionTracker
from g1_description.sim.world import World

QUEUE_SIZE = 100
"""Messages queued for a slow subscriber: a tenth of a second of steps."""

RESET_SILENCE = 0.15
"""Silence before and after the first /clock when time went back, in [s] of wall time. A
transform of the old time that arrives after the new clock, or one of the new time
before it, corrupts a TF buffer."""

SETTLE_TIME = 0.1
"""Delay of a state after a change while time stands still, in [s] of wall time: a
script that sets and then steps has stepped by then."""

START_SILENCE = 0.3
"""Silence after the start in [s] of wall time, in which only /clock is published: until
then, subscribers of an earlier simulator may be at its time. roscpp takes up to a
quarter of a second to connect."""

CLOCK_PERIOD = 0.01
"""Time between two messages of /clock in that silence, in [s]."""

STALL_TIMEOUT = 0.5
"""Time without progress after which a subscriber is no longer waited for, in [s]."""


class StateTopics:
    """Publishes /clock, then the states of that time."""

    def __init__(self, world: World, parameters: GazeboParameters) -> None:
        """Advertise the topics.

        Args:
            world: Source of the states.
            parameters: Rates, and whether only /clock is published.
        """
        self._world = world
        self._parameters = parameters
        self._seq = 0
        self._clock_ns = self._sent_ns = world.time_ns
        self._sent = self._changed = time.monotonic()
        self._silent_until = math.inf
        self._repeated = self._repeated_until = -math.inf
        self._is_settled = False
        self._shown: dict[Callable, tuple[int, bytes]] = {}
        """Time in [ns] and content of the last message of each latched topic."""
        self._links, self._models = LinkStatesEncoder(), LinkStatesEncoder()
        self._clock = DirectPublisher("/clock", Clock, QUEUE_SIZE)
        self._topics, self._latched = [], []
        if parameters.enable_ros_network:
            for name, kind, messages, latch in (
                ("~link_states", LinkStates, self._link_states, False),
                ("~model_states", ModelStates, self._model_states, False),
                ("~simulator_state", SimulatorState, self._simulator_state, True),
                ("~world_state", WorldState, self._world_state, True),
                ("~motor_states", MotorStates, self._motor_states, False),
            ):
                topic = DirectPublisher(name, kind, QUEUE_SIZE, latch)
                self._topics.append((topic, messages))
                if latch:
                    self._latched.append((topic, messages))

    def publish(self, is_last: bool = False) -> None:
        """Publish the time, then the states of that time.

        Args:
            is_last: Whether it is the last requested step, which is published at any
                rate.
        """
        if is_last or self._is_due(self._parameters.pub_clock_frequency):
            self._publish_clock()
        if is_last or self._is_due(self._parameters.link_states_rate):
            for topic, messages in self._topics:
                if topic.get_num_connections():
                    for message in messages():
                        topic.publish(message)
                    self._sent, self._sent_ns = time.monotonic(), self._world.time_ns
                else:
                    topic.forget()
            self._world.motions.show()
        self._is_settled, self._changed = False, -math.inf

    def _publish_clock(self) -> None:
        self._clock_ns = self._world.time_ns
        self._clock.publish(Clock(stamp_from_ns(self._clock_ns)))

    def wait_for_room(self) -> None:
        """Wait until slow subscribers have read their queued messages."""
        for topic, _ in self._topics:
            topic.wait_for_room(STALL_TIMEOUT)

    def is_silent(self, paused: bool) -> bool:
        """Return whether states may not be published yet, because time went back.

        It also went back for subscribers of an earlier simulator. /clock is published
        here when it is due.

        Args:
            paused: Whether time stands still: then /clock is published at once, as
                hardly any message is in transit.
        """
        now = time.monotonic()
        if self._silent_until == math.inf:  # until now the node advertised services
            self._silent_until = self._repeated_until = now + START_SILENCE
        if self._world.time_ns < max(self._clock_ns, self._sent_ns):
            for topic, _ in self._latched:
                topic.forget()
            is_heard = any(topic.get_num_connections() for topic, _ in self._topics)
            if is_heard and not paused and now < self._sent + RESET_SILENCE:
                return True
            self._publish_clock()
            self._sent_ns = self._world.time_ns
            if is_heard:
                self._silent_until = max(self._silent_until, now + RESET_SILENCE)
        if self._repeated + CLOCK_PERIOD <= now < self._repeated_until:
            self._repeated = now
            self._publish_clock()
        return now < self._silent_until

    def change(self) -> None:
        """Record that the world may have changed while time stands still."""
        if self._is_settled:
            self._is_settled, self._changed = False, time.monotonic()

    def settle(self) -> float:
        """Publish a change while time stands still, when it is due.

        Only simulator_state, world_state and, if a rate skipped it, /clock: Gazebo's
        own topics are silent then.

        Returns:
            Time until a change is due, in [s]; infinite if there is none.
        """
        for topic in (self._clock, *(topic for topic, _ in self._topics)):
            topic.flush()
        if self._is_settled:
            return math.inf
        left = self._changed + SETTLE_TIME - time.monotonic()
        if left > 0.0:
            return left
        self._is_settled = True
        if self._world.time_ns != self._clock_ns:
            self._publish_clock()
        for topic, messages in self._latched:
            shown = self._shown.get(messages)
            (message,) = messages()
            if self._shown[messages] != shown:
                topic.publish(message)
                self._sent, self._sent_ns = time.monotonic(), self._world.time_ns
        self._world.motions.show()
        return math.inf

    def steps_to_due(self) -> int:
        """Count the steps until a state or the time is due."""
        parameters, step_ns = self._parameters, self._world.properties.step_ns
        steps = []
        for rate in (parameters.pub_clock_frequency, parameters.link_states_rate):
            period_ns = self._period_ns(rate)
            left_ns = period_ns - self._world.time_ns % period_ns
            steps.append(-(-left_ns // step_ns))
        return min(steps)

    def _is_due(self, rate: float) -> bool:
        """Return whether a rate publishes this step."""
        left_ns = self._world.time_ns % self._period_ns(rate)
        return left_ns < self._world.properties.step_ns

    def _period_ns(self, rate: float) -> int:
        """Return the time between two publications in [ns]; of rate 0, a step."""
        properties = self._world.properties
        steps = int(1.0 / (properties.time_step * rate) + 1e-9) if rate else 1
        return max(1, steps) * properties.step_ns

    def _link_states(self) -> Iterator[Prepared]:
        yield ready(self._encoded_links())

    def _model_states(self) -> Iterator[Prepared]:
        names = self._world.model_names
        yield ready(self._models.encode(names, *self._world.model_states()))

    def _world_state(self) -> Iterator[Prepared]:
        """Give stamped states of all links, without wrenches."""
        yield self._stamped(self._world_state, struct.pack("<I", 0))

    def _simulator_state(self) -> Iterator[Prepared]:
        """Give stamped states of all links and motors."""
        motors = [*self._encoded_motors()]
        count = struct.pack("<I", len(motors))
        yield self._stamped(self._simulator_state, count + b"".join(motors))

    def _stamped(self, messages: Callable, rest: bytes) -> Prepared:
        """Put a header before the links, and the rest behind them."""
        self._seq += 1
        time_ns, frame = self._world.time_ns, b"world"
        stamp = divmod(time_ns, 1_000_000_000)
        header = struct.pack("<4I", self._seq, *stamp, len(frame)) + frame
        content = self._encoded_links() + rest
        self._shown[messages] = time_ns, content
        return ready(header + content)

    def _motor_states(self) -> Iterator[Prepared]:
        return map(ready, self._encoded_motors())

    def _encoded_motors(self) -> Iterator[bytes]:
        """Encode the states of the joints of each model that has any."""
        world = self._world
        for model in world.models.values():
            if model.joint_names:
                efforts = world.engine.efforts(model) if world.is_dynamic else None
                motors = MotorArrays(
                    model.name,
                    model.joint_names,
                    model.position,
                    model.velocity,
                    efforts,
                    model.commanded,
                    model.commanded_base,
                    world.motions.has_reached_sample(model),
                )
                yield encode_motors(world.time_ns, motors)

    def _encoded_links(self) -> bytes:
        names = self._world.link_names
        return self._links.encode(names, *self._world.link_states())


def tracking_message(tracker: MotionTracker) -> TrackingReport:
    """Convert a report on a tracked motion."""
    report = tracker.report
    return TrackingReport(
        model_name=tracker.model.name,
        start=stamp_from_ns(tracker.start_ns),
        duration=report.duration,
        joint_names=list(report.joint_names),
        rms_errors=report.rms_errors.tolist(),
        largest_errors=report.largest_errors.tolist(),
        limit_shares=report.limit_shares.tolist(),
        has_fallen=report.fall_time is not None,
        fall_time=report.fall_time or 0.0,
    )
