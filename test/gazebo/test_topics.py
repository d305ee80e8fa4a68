"""What the simulator publishes, when, and what it waits for."""

import numpy as np
import pytest
from worlds import Bench

pytest.importorskip("rospy", reason="rospy is not installed")

from g1_description.gazebo import topics
from g1_description.gazebo.parameters import GazeboParameters

SLIDER = """<robot name="r"><link name="a"/><link name="b"/>
<joint name="slide" type="prismatic"><parent link="a"/><child link="b"/>
<limit lower="-1" upper="1" effort="1" velocity="1"/></joint></robot>"""
HERE = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0])


class Topic:
    """A publisher that records what is done with it; one subscriber, if it is heard."""

    heard = "~motor_states"

    def __init__(self, name, kind, queue_size, latch=False):
        self.name, self.done = name, []

    def get_num_connections(self):
        return int(self.name == self.heard)

    def publish(self, message):
        self.done.append(message)

    def forget(self):
        pass

    def flush(self):
        self.done.append("flush")

    def wait_for_room(self, timeout):
        self.done.append("wait")


@pytest.fixture
def made(monkeypatch):
    """Give the publishers by name."""
    publishers = {}

    def publisher(name, *args):
        publishers[name] = Topic(name, *args)
        return publishers[name]

    monkeypatch.setattr(topics, "DirectPublisher", publisher)
    return publishers


def test_the_states_of_motors_are_a_topic_like_the_others(made, monkeypatch):
    monkeypatch.setattr(topics, "START_SILENCE", 0.0)
    world = Bench()
    for name in ("one", "two"):
        world.spawn_urdf(name, SLIDER, HERE)
    world.time_ns = 2_000_000
    states = topics.StateTopics(world, GazeboParameters())
    motors = made["~motor_states"]
    states.publish(is_last=True)
    assert [message.model_name for message in motors.done] == ["one", "two"]
    assert motors.done[1].header.stamp.to_nsec() == 2_000_000
    assert motors.done[1].q == [0.0]
    states.wait_for_room()
    states.settle()
    assert motors.done[2:] == ["wait", "flush"]
    assert not states.is_silent(paused=False)
    world.time_ns = 0
    assert states.is_silent(paused=False)  # subscribers see no old state after it
    world.close()
