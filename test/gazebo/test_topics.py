"""What the simulator publishes, when, and what it waits for."""

import io

import numpy as np
import pytest
from worlds import Bench

pytest.importorskip("rospy", reason="rospy is not installed")

from g1_description.msg import MotorStates, SimulatorState

from g1_description.gazebo import topics
from g1_description.gazebo.parameters import GazeboParameters
from g1_description.ros.conversions import pose_to_array

MASS = """<inertial><mass value="1"/>
<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial>"""
SLIDER = f"""<robot name="r"><link name="a">{MASS}</link><link name="b">{MASS}</link>
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


def read(kind, message):
    """Deserialize a message with the generated class, the outside oracle."""
    buffer = io.BytesIO()
    message.serialize(buffer)
    return kind().deserialize(buffer.getvalue())


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
    one, two = (read(MotorStates, message) for message in motors.done)
    assert (one.model_name, two.model_name) == ("one", "two")
    assert two.header.stamp.to_nsec() == 2_000_000
    assert (two.joint_names, two.q, two.dq, two.tau) == (["slide"], (0,), (0,), ())
    states.wait_for_room()
    states.settle()
    assert motors.done[2:] == ["wait", "flush"]
    assert not states.is_silent(paused=False)
    world.time_ns = 0
    assert states.is_silent(paused=False)  # subscribers see no old state after it
    world.close()


@pytest.mark.parametrize("physics", ["kinematic", "hold"])
def test_a_state_has_the_links_and_the_motors_of_one_time(made, monkeypatch, physics):
    monkeypatch.setattr(Topic, "heard", "~simulator_state")
    world = Bench(physics)
    world.spawn_urdf("one", SLIDER, HERE)
    states = topics.StateTopics(world, GazeboParameters())
    for _ in range(3):
        world.step()
        states.publish()
    last = read(SimulatorState, made["~simulator_state"].done[-1])
    (motors,) = last.motors
    assert last.header.stamp == motors.header.stamp
    assert motors.header.stamp.to_nsec() == world.time_ns
    assert tuple(last.name) == world.link_names
    poses = [pose_to_array(pose) for pose in last.pose]
    np.testing.assert_array_equal(poses, world.link_states()[0])
    efforts = world.engine.efforts(world.model("one")) if world.is_dynamic else ()
    assert motors.tau == tuple(efforts)
    world.close()


def test_a_change_while_time_stands_still_is_published_once(made, monkeypatch):
    monkeypatch.setattr(Topic, "heard", "")
    monkeypatch.setattr(topics, "SETTLE_TIME", 0.0)
    world = Bench()
    world.spawn_urdf("one", SLIDER, HERE)
    states = topics.StateTopics(world, GazeboParameters())
    for position in (0.0, 0.5, 0.5):
        world.set_joint_positions("one", {"slide": position})
        states.settle()
        states.change()
    sent = made["~simulator_state"].done
    sent = [read(SimulatorState, message) for message in sent if message != "flush"]
    assert [state.pose[-1].position.x for state in sent] == [0.0, 0.5]
    world.close()
