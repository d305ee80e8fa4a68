"""A planner on a busy machine, with states at 200 Hz and of every step.

One busy process per core runs beside it. A plain rospy node publishes a smooth motion
of all joints, 50 samples a second, and reads /joint_states through an ordinary
subscriber with a long queue. A sample counts as seen when all joints of a message match
it to 1e-9 rad; latency runs from just before it is published until the node's callback
gets it. Samples less than 5 ms after the previous one were sent late by the planner,
which waited for a core. Shares of a core are those during the motion.
"""

import sys
from pathlib import Path

import numpy as np

from .nodes import Graph

HERE = Path(__file__).resolve().parent
RUNS = 5
RATES = (200, 1000)  # [Hz]
NODES = ("/gazebo", "/link_states_bridge", "/robot_state_publisher")
NAMES = ("simulator", "bridge", "robot_state_publisher", "planner")
LONGEST = 120.0  # [s] that the planner may take


def run(bench):
    """Let the planner run at each rate."""
    runs = bench.count(RUNS, 1)
    for rate in RATES:
        with bench.attempt(f"{rate} Hz, {runs} motions"):
            report(bench, f"{rate} Hz", measure(bench, rate, runs))


def measure(bench, rate, runs):
    """Give what the planner told of each motion."""
    planner = (sys.executable, HERE / "planner_node.py")
    with Graph() as graph, graph.launch(bench.model, f"rate:={rate}"):
        pids = [graph.node(name).pid for name in NODES]
        graph.keep_busy()
        return [graph.start([*planner, *pids]).result(LONGEST) for _ in range(runs)]


def report(bench, name, told):
    """Keep the figures of one rate."""
    times = np.concatenate([one["latencies"] for one in told])
    bench.add(f"{name}: samples sent", sum(one["sent"] for one in told))
    bench.add(f"{name}: samples seen exactly", len(times))
    bench.add(
        f"{name}: samples sent within 5 ms after another",
        sum(one["close"] for one in told),
    )
    if len(times):
        bench.add_latencies(f"{name}: sample to planner", times)
    repeated = 100.0 * np.mean([one["repeated"] for one in told])
    bench.add(f"{name}: stamps that repeat", repeated, "%", "= 0")
    shares = 100.0 * np.mean([one["shares"] for one in told], axis=0)
    for node, share in zip(NAMES, shares):
        bench.add(f"{name}: {node}'s share of a core", share, "%")
