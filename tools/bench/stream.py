"""A recorded stream of link states, and how it is played to a node."""

from __future__ import annotations

import gc
import struct
import time
from contextlib import contextmanager
from typing import NamedTuple

import numpy as np
from gazebo_msgs.msg import LinkStates, WorldState
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState

from g1_description.files.uris import with_absolute_uris
from g1_description.robot.assembly import SCOPE
from g1_description.robot.lumping import lump_fixed_joints
from g1_description.robot.urdf import parse_urdf
from g1_description.ros.wire import LinkStatesEncoder
from g1_description.sim.world import World

from tcpros import packed

ROBOT = "g1_robot"
STEPS = 5000  # of the recording; it begins again after them
PERIOD_NS = 1_000_000  # simulated time from one message to the next
TIME = struct.Struct("<II")
HEADER = struct.Struct("<IIII5s")  # seq, seconds, nanoseconds, "world"
NO_WRENCHES = struct.pack("<I", 0)
QUIET = 0.3  # [s] without an answer: there is none to come


class Recording(NamedTuple):
    """A robot that hangs and swings, a row per step of 1 ms."""

    link_names: tuple
    """Scoped names; the first is that of the ground plane."""

    poses: np.ndarray
    """Poses in the world, shape (n, n_links, 7)."""

    twists: np.ndarray
    """Twists along the world's axes, shape (n, n_links, 6)."""

    joint_names: tuple
    positions: np.ndarray
    """What the simulator knows the joints to be at, in [rad], shape (n, n_joints)."""

    aligned: np.ndarray
    """Whether a joint's two links are aligned at zero, shape (n_joints,)."""


def read_urdf(path):
    """Read a robot as the launch file does."""
    return with_absolute_uris(path.read_text(encoding="utf-8"), path.parent)


def record(urdf, seed, steps=STEPS):
    """Let a robot hang, limp, from a random configuration; give the ``Recording``."""
    world = World("limp")
    hung = np.array([0.0, 0.0, 1.5, 0.0, 0.0, 0.0, 1.0])
    assembly = lump_fixed_joints(parse_urdf(urdf))
    world.spawn(ROBOT, assembly, hung, fixed_base=True)
    robot = world.model(ROBOT)
    start = np.random.default_rng(seed).uniform(robot.lower, robot.upper)
    world.set_joint_positions(ROBOT, dict(zip(robot.joint_names, start)))
    poses, twists, positions = [], [], []
    for _ in range(steps):
        world.step()
        for kept, value in zip((poses, twists), world.link_states()):
            kept.append(value)
        positions.append(np.array(robot.position))
    joints = assembly.description.movable_joints
    recording = Recording(
        world.link_names,
        *(np.array(poses), np.array(twists)),
        *(robot.joint_names, np.array(positions)),
        np.array([abs(joint.pose[6]) == 1.0 for joint in joints]),
    )
    world.close()
    return recording


def encoded(recording):
    """Write each step as link states, without their length."""
    encoder = LinkStatesEncoder()
    pairs = zip(recording.poses, recording.twists)
    return [encoder.encode(recording.link_names, *pair) for pair in pairs]


def stamped(link_states, seq, stamp):
    """Make a world state of link states.

    Args:
        link_states: A message, without its length.
        seq: Its number.
        stamp: Its time, seconds and nanoseconds.
    """
    header = HEADER.pack(seq, *stamp, len(b"world"), b"world")
    return header + link_states + NO_WRENCHES


def crowd(recording, count, steps):
    """Put many robots into a recording's world, each at another moment of it.

    Args:
        recording: That of one robot.
        count: How many robots; they are called robot_0 and so on.
        steps: How many steps are wanted.
    """
    n = len(recording.poses)
    row = np.arange(steps)[:, np.newaxis] + 37 * np.arange(count)
    poses, twists = recording.poses[row % n, 1:], recording.twists[row % n, 1:]
    poses[..., 0] += np.arange(count)[:, np.newaxis]
    links = [name.split(SCOPE, 1)[1] for name in recording.link_names[1:]]
    names = [f"robot_{n}{SCOPE}{link}" for n in range(count) for link in links]
    return recording._replace(
        link_names=(recording.link_names[0], *names),
        poses=np.hstack([recording.poses[:steps, :1], poses.reshape(steps, -1, 7)]),
        twists=np.hstack([recording.twists[:steps, :1], twists.reshape(steps, -1, 6)]),
    )


@contextmanager
def no_collector():
    """Keep Python's garbage collector from interrupting a measurement."""
    gc.collect()
    gc.disable()
    try:
        yield
    finally:
        gc.enable()


class Answers:
    """What a node publishes on its joint states."""

    def __init__(self, keep=True):
        """Begin with none; only count them where they are not kept."""
        self.keep = keep
        self.count, self.times, self.bodies = 0, [], []

    def take(self, now, body):
        """Take one."""
        self.count += 1
        if self.keep:
            self.times.append(now)
            self.bodies.append(body)

    def clear(self):
        """Forget all."""
        self.count, self.times, self.bodies = 0, [], []


class Feed:
    """Plays messages to a node, each after the time it is of.

    Each goes out as the stand-in does it: as link states, and as a world state, which
    has the time in it, to nodes that want that.
    """

    def __init__(self, peer, messages, answers, is_stamped=False):
        """Publish the topics, and be where a service is looked for.

        Args:
            peer: The node that publishes.
            messages: Link states, without their length; after the last comes the
                first.
            answers: Counts what the node answers.
            is_stamped: Whether the node that is measured takes world states.
        """
        self._peer, self._messages, self.answers = peer, messages, answers
        self._clock = peer.advertise("/clock", Clock)
        self._links = peer.advertise("/gazebo/link_states", LinkStates)
        self._world = peer.advertise("/gazebo/world_state", WorldState)
        self._states = self._world if is_stamped else self._links
        peer.offer("/gazebo/set_model_configuration")
        self._sources = []
        self.steps = 0

    def listen(self, topic):
        """Take the node's answers from a topic."""
        source = self._peer.subscribe(topic, JointState, self.answers.take)
        self._sources.append(source)

    def withdraw_world_state(self):
        """Be a simulator without world_state, such as Gazebo."""
        self._peer.withdraw("/gazebo/world_state")

    def wait_for(self, node, timeout=30.0):
        """Wait until a node listens and all its answers come here.

        Args:
            node: The ``Program``; it may be called whatever it likes.
            timeout: Longest wait in [s].
        """

        def connected():
            heard = self._clock.callers and self._states.callers
            heard_by = set(self._states.callers.values())
            return (
                node.check()
                and heard
                and heard_by <= set(self._clock.callers.values())
                and all(source.sources for source in self._sources)
            )

        self._peer.wait(connected, "the connections to the node", timeout)

    def play(self, rate, seconds):
        """Send messages at a rate; give the times they were sent, shape (n,).

        What is late is not made up for by a burst: the next comes a period later.
        """
        sent = np.empty(round(rate * seconds))
        due, period = time.monotonic(), 1.0 / rate
        for row in range(len(sent)):
            self._peer.serve(due)
            self.steps += 1
            stamp = divmod(self.steps * PERIOD_NS, 1_000_000_000)
            links = self._messages[(self.steps - 1) % len(self._messages)]
            world = packed(stamped(links, self.steps, stamp))
            links = packed(links)
            self._clock.send(packed(TIME.pack(*stamp)))
            sent[row] = time.monotonic()
            self._links.send(links)
            self._world.send(world)
            due = (due if sent[row] < due + period else sent[row]) + period
        self._peer.serve(due)
        return sent

    def drain(self, timeout=20.0):
        """Wait for the first answer, then until no more come."""
        self._peer.serve(time.monotonic() + timeout, lambda: self.answers.count)
        end, count = time.monotonic() + timeout, -1
        while count != self.answers.count and time.monotonic() < end:
            count = self.answers.count
            self._peer.serve(time.monotonic() + QUIET)
