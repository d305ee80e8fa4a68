"""From roslaunch to the first joint_states that contain the robot.

The master is already running, and the display is launched without RViz. The time runs
from the start of roslaunch until joint_states with joint names are read. A first launch
is not counted, so that files are in the system's cache.
"""

import time
from contextlib import closing
from pathlib import Path

import numpy as np
from sensor_msgs.msg import JointState

from .figures import OWN_MODEL
from .nodes import Graph
from .peer import Peer

VENDOR = Path(__file__).resolve().parents[3] / "shared/data/unitree_g1/g1_29dof.urdf"
RUNS = 5


def run(bench):
    """Time launches of the package's model, and of the vendor's where it is here."""
    measure_models(bench, measure, "<= 2")


def measure_models(bench, measure, target):
    """Measure the package's model, and the vendor's, which has a target."""
    own = bench.model == OWN_MODEL
    measure(bench, "the package's model" if own else "the model", bench.model)
    if VENDOR.exists():
        measure(bench, "the vendor's model", VENDOR, target)
    else:
        bench.leave_out("the vendor's model: it is not here")


def measure(bench, name, model, target=""):
    """Time launches of one model."""
    runs = bench.count(RUNS, 2)
    with bench.attempt(f"{name}, {runs} launches and one before"), Graph() as graph:
        times = [time_launch(graph, model) for _ in range(runs + 1)][1:]
        bench.add(f"{name}: median of {runs}", np.median(times), "s", target)
        bench.add(f"{name}: slowest", max(times), "s")


def time_launch(graph, model):
    """Launch once; give the time to the first joint_states in [s]."""
    came = []

    def take(now, body):
        if JointState().deserialize(body).name:
            came.append(now)

    with closing(Peer()) as peer:
        peer.subscribe("/joint_states", JointState, take)
        start = time.monotonic()
        with graph.launch(model):
            peer.wait(lambda: came, "joint_states", 60.0)
    return came[0] - start
