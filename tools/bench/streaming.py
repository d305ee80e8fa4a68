"""A planner that streams base and joints, a message per sample, and today's commands.

A process sends messages of one point on the topic motion, all joints and the base in
each, and reads the bytes of /joint_states. Each sample is unlike all others, so that it
is known in the states; latency runs from just before a sample is sent
until the bytes of the first state with it have been read. Samples that come between the
same two steps cannot all be shown: the simulator steps at 1 kHz. Beside it the same
joints are sent as joint_commands, without the base. Shares of a core are those of the
time in which samples were sent.
"""

import sys
from pathlib import Path

from .nodes import EACH_STEP, Graph

HERE = Path(__file__).resolve().parent
SECONDS = 60.0
CASES = (
    ("motion at 100 Hz", "motion", 100),
    ("joint_commands at 100 Hz", "joint_commands", 100),
    ("motion at 1 kHz", "motion", 1000),
    ("joint_commands at 1 kHz", "joint_commands", 1000),
)
NODES = {"simulator": "/gazebo", "bridge": "/link_states_bridge"}
GRACE = 60.0  # [s] for all but the sending


def run(bench):
    """Stream in each way."""
    seconds = bench.seconds(SECONDS, 5.0)
    for name, topic, rate in CASES:
        with bench.attempt(f"{name}, {seconds:g} s"):
            report(bench, name, measure(bench, topic, rate, seconds))


def measure(bench, topic, rate, seconds):
    """Give what the streaming process saw."""
    command = (sys.executable, HERE / "streaming_node.py", topic, rate, seconds)
    with Graph() as graph, graph.launch(bench.model, EACH_STEP):
        pids = [graph.node(name).pid for name in NODES.values()]
        return graph.start([*command, *pids]).result(seconds + GRACE)


def report(bench, name, seen):
    """Keep the figures of one way."""
    bench.add(f"{name}: samples sent", seen["sent"])
    bench.add(f"{name}: samples shown", seen["shown"])
    bench.add(f"{name}: samples lost", seen["sent"] - seen["shown"])
    bench.add(f"{name}: samples shown out of order", seen["disorder"], "", "= 0")
    if seen["latencies"]:
        bench.add_latencies(f"{name}: sample to joint_states", seen["latencies"])
    for node, share in zip(NODES, seen["shares"]):
        bench.add(f"{name}: {node}'s share of a core", 100.0 * share, "%")
