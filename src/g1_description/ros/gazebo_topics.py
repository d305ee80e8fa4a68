"""What the stand-in publishes after each step."""

from __future__ import annotations

import struct

import numpy as np
from gazebo_msgs.msg import LinkStates, ModelStates, WorldState
from rosgraph_msgs.msg import Clock

from ..sim.world import World
from .direct_publisher import DirectPublisher
from .link_states import LinkStatesEncoder
from .messages import (
    PreparedLinkStates,
    PreparedModelStates,
    PreparedWorldState,
    stamp_from_ns,
)
from .parameters import GazeboParameters

QUEUE = 100
"""Messages kept for a slow subscriber; a tenth of a second of steps."""


class StateTopics:
    """First the time, then the states of that time, to whom listens."""

    def __init__(self, world: World, parameters: GazeboParameters) -> None:
        """Advertise the topics.

        Args:
            world: What the messages tell of.
            parameters: Which steps are published, and whether more than /clock is.
        """
        self._world = world
        self._parameters = parameters
        self._steps = 0
        self._seq = 0
        self._links, self._models = LinkStatesEncoder(), LinkStatesEncoder()
        self._clock = DirectPublisher("/clock", Clock, QUEUE)
        self._topics = (
            []
            if not parameters.enable_ros_network
            else [
                (DirectPublisher(f"~{name}", kind, QUEUE), message)
                for name, kind, message in (
                    ("link_states", LinkStates, self._link_states),
                    ("model_states", ModelStates, self._model_states),
                    ("world_state", WorldState, self._world_state),
                )
            ]
        )

    def publish(self) -> None:
        """Publish the time, then the states of that time."""
        self._steps += 1
        if self._is_due(self._parameters.pub_clock_frequency):
            self._clock.publish(Clock(stamp_from_ns(self._world.time_ns)))
        if self._is_due(self._parameters.link_states_rate):
            for topic, message in self._topics:
                if topic.get_num_connections():
                    topic.publish(message())

    def flush(self) -> None:
        """Send slow subscribers what is kept for them, while nothing is published."""
        for topic in (self._clock, *(topic for topic, _ in self._topics)):
            topic.flush()

    def _is_due(self, rate: float) -> bool:
        """Tell whether this step is one of those that keep a rate; 0: all are."""
        if not rate:
            return True
        every = int(1.0 / (self._world.properties.time_step * rate) + 1e-9)
        return self._steps % max(1, every) == 0

    def _link_states(self) -> PreparedLinkStates:
        """Tell the states of all links."""
        message = PreparedLinkStates()
        message.data = self._encoded_links()
        return message

    def _model_states(self) -> PreparedModelStates:
        """Tell the states of all models."""
        models = self._world.models.values()
        message = PreparedModelStates()
        message.data = self._models.encode(
            list(self._world.models),
            np.array([model.pose for model in models]),
            np.array([model.twist for model in models]),
        )
        return message

    def _world_state(self) -> PreparedWorldState:
        """Tell the states of all links with their time; forces are not known."""
        message = PreparedWorldState()
        self._seq += 1
        message.header.seq = self._seq
        message.header.stamp = stamp_from_ns(self._world.time_ns)
        message.header.frame_id = "world"
        message.data = self._encoded_links() + struct.pack("<I", 0)
        return message

    def _encoded_links(self) -> bytes:
        """Write the states of all links."""
        names = self._world.link_names()
        return self._links.encode(names, *self._world.link_states())
