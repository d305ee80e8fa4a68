"""The bridge at 1 kHz, beside nodes that do the same or less.

A process without rospy plays a recording of the G1, hanging and swinging. For each step
it sends /clock, then the states, on sockets without delay; it also receives
/joint_states. The bridge uses /gazebo/world_state, the other nodes know only
/gazebo/link_states. Latency runs from just before the states are written until
joint_states is read. Joint states are matched with states by their positions, in order,
so a message that waited in a queue shows. The empty node sends no positions: its
messages are matched by order, and only if none is lost. Processor time is that of all
threads of the node between the first and the last message, after two seconds of
warm-up, per message sent. robot_state_publisher does not run. Gaps between messages are
the sender's, and show how busy the machine was. The empty node shows the share of
rospy: it receives bytes and publishes the same message each time. The naive node is
plain rospy with a scipy Rotation per joint. The original node is the script that this
bridge replaces; it is not part of the repository.
"""

from __future__ import annotations

import sys
from contextlib import closing
from pathlib import Path
from typing import NamedTuple

import numpy as np

from . import stream
from .matching import match, positions_of
from .nodes import Graph, MeasurementError
from .peer import Peer

HERE = Path(__file__).resolve().parent
ORIGINAL = HERE.parents[2] / "shared" / "clients" / "link_states_bridge_original.py"
OURS = ("rosrun", "g1_description", "link_states_bridge.py")
RATE = 1000.0  # [Hz]
WARM_UP = 2.0  # [s]
GAP = 2e-3  # [s]
EXACT = 1e-9  # [rad]


class Node(NamedTuple):
    """A node to measure."""

    name: str
    command: tuple
    seconds: float
    tolerance: float | None = EXACT
    """Largest error of an answer in [rad]; None where it tells no positions."""

    only_aligned: bool = False
    """Whether only joints whose links are aligned at zero are told right."""

    is_stamped: bool = False
    """Whether it takes world states."""

    targets: tuple = ("", "", "")
    """For the median, the 99th percentile and what is lost."""


NODES = (
    Node("bridge", OURS, 60.0, is_stamped=True, targets=("< 0.3", "< 2", "= 0")),
    Node("empty node", (sys.executable, HERE / "empty_node.py"), 15.0, None),
    Node("naive node", (sys.executable, HERE / "naive_node.py"), 12.0),
    # It takes angles below 1e-6 for zero.
    Node("original node", (sys.executable, ORIGINAL), 12.0, 2e-6, True),
)


class Run(NamedTuple):
    """One node, fed."""

    rows: np.ndarray
    """Steps of the recording that were sent, shape (n,)."""

    sent: np.ndarray
    """When, in [s], shape (n,)."""

    answers: stream.Answers
    cpu_seconds: float
    wall_seconds: float
    answered: int
    """Answers until the last message was sent."""


def run(bench):
    """Measure each node; compare ours with the others."""
    urdf = stream.read_urdf(bench.model)
    bench.say(f"recording {stream.STEPS} steps")
    recording = stream.record(urdf, bench.seed)
    messages = stream.encoded(recording)
    costs = {}
    with Graph() as graph:
        prepare(graph, urdf, recording)
        for node in NODES:
            if node.command[-1] == ORIGINAL and not ORIGINAL.exists():
                bench.leave_out(f"{node.name}: it is not here")
                continue
            seconds = bench.seconds(node.seconds, 3.0)
            with bench.attempt(f"{node.name}, {seconds:.0f} s"):
                fed = feed(graph, node, messages, seconds)
                costs[node.name] = report(bench, node, fed, recording)
    compare(bench, costs)


def prepare(graph, urdf, recording):
    """Give the nodes the parameters they look for."""
    graph.master.setParam("/use_sim_time", True)
    graph.master.setParam("/robot_description", urdf)
    graph.master.setParam("/joint_names", list(recording.joint_names))


def feed(graph, node, messages, seconds):
    """Start a node, play to it, and end it.

    Args:
        graph: Where it runs.
        node: The ``Node``.
        messages: What is played, see ``stream.Feed``.
        seconds: How long, after the warm-up.

    Returns:
        The ``Run``.
    """
    with closing(Peer()) as peer, graph.start(node.command) as program:
        player = stream.Feed(peer, messages, stream.Answers(), node.is_stamped)
        player.listen("/joint_states")
        player.wait_for(program)
        return play(program, player, len(messages), seconds)


def play(program, player, n_messages, seconds, rate=RATE):
    """Play to a node that is connected; give the ``Run``."""
    player.play(rate, WARM_UP)
    player.drain()
    answers = player.answers
    answers.clear()
    first = player.steps
    with stream.no_collector():
        meter = program.meter()
        sent = player.play(rate, seconds)
        cpu, wall = meter()
        answered = answers.count
        player.drain()
    rows = np.arange(first, player.steps) % n_messages
    return Run(rows, sent, answers, cpu, wall, answered)


def report(bench, node, fed, recording):
    """Keep the figures of one node; give its cost per message in [us]."""
    if not fed.answered:
        raise MeasurementError("no joint_states came")
    cost = 1e6 * fed.cpu_seconds / len(fed.sent)
    share = 100.0 * fed.cpu_seconds / fed.wall_seconds
    bench.add(f"{node.name}: processor time per message", cost, "us")
    bench.add(f"{node.name}: share of a core", share, "%")
    found = matched(node, fed, recording)
    if found is None:
        bench.leave_out(f"{node.name}: latency, as some of its answers are lost")
        found = np.arange(len(fed.answers.times))
    else:
        answered = found >= 0
        times = np.array(fed.answers.times)[answered] - fed.sent[found[answered]]
        bench.add_latencies(f"{node.name}: latency", times, node.targets[:2])
    lost = len(fed.sent) - np.count_nonzero(found >= 0)
    bench.add(f"{node.name}: messages sent", len(fed.sent))
    bench.add(f"{node.name}: messages lost", lost, "", node.targets[2])
    gaps = np.count_nonzero(np.diff(fed.sent) > GAP)
    bench.add(f"{node.name}: gaps over 2 ms between messages", gaps)
    return cost


def matched(node, fed, recording):
    """Find the message of each answer; None where that can't be known."""
    if node.tolerance is None:
        same = len(fed.answers.times) == len(fed.sent)
        return np.arange(len(fed.sent)) if same else None
    names = np.array(recording.joint_names)
    columns = recording.aligned if node.only_aligned else np.full(len(names), True)
    told = positions_of(fed.answers.bodies, names[columns].tolist())
    sent = recording.positions[fed.rows][:, columns]
    found = match(sent, told, node.tolerance)
    if (found < 0).mean() > 0.01:
        raise MeasurementError(f"{(found < 0).sum()} of its answers are wrong")
    return found


def compare(bench, costs):
    """Say how ours compares."""
    for other, target in (("empty", "<= 1.6"), ("naive", ""), ("original", "<= 0.25")):
        if "bridge" in costs and f"{other} node" in costs:
            ratio = costs["bridge"] / costs[f"{other} node"]
            bench.add(f"processor time, bridge / {other} node", ratio, "", target)
