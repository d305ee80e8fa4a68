"""How still a foot stands on TF while base and joints move together.

A plain rospy node moves the pelvis up and down with exact kinematics, so that the feet
stand still: the base through /gazebo/set_model_state, the joints through
/joint_commands, 100 times a second for five seconds, with the default display. The
same node has a plain tf2_ros listener and looks up map -> left_ankle_roll_link every
20 ms. The measurement is made twice: on a quiet machine, and with one busy process per
core.
"""

import sys
from pathlib import Path

import numpy as np

from .nodes import Graph, idle

HERE = Path(__file__).resolve().parent
RUNS = 5
LONGEST = 120.0  # [s] that a run may take


def run(bench):
    """Move on a quiet machine, then on a busy one."""
    runs = bench.count(RUNS, 1)
    for name, is_busy in (("quiet", False), ("busy", True)):
        with bench.attempt(f"{name}, {runs} runs"):
            share = idle()
            report(bench, name, measure(bench, runs, is_busy))
            bench.add(f"{name}: share of all cores that was idle", 100 * share(), "%")


def measure(bench, runs, is_busy):
    """Give what the node told of each run."""
    with Graph() as graph, graph.launch(bench.model):
        graph.node("/robot_state_publisher")
        if is_busy:
            graph.keep_busy()
        told = []
        for _ in range(runs):
            squat = graph.start([sys.executable, HERE / "squat_node.py"])
            told.append(squat.result(LONGEST))
            (x, z), worst = told[-1]["rms"], max(told[-1]["worst"])
            bench.say(f"rms x {x:.2f} mm, z {z:.2f} mm, worst {worst:.2f} mm")
        return told


def report(bench, name, told):
    """Keep the figures of one kind of machine."""
    rms, worst = (np.array([one[key] for one in told]) for key in ("rms", "worst"))
    for column, axis in enumerate("xz"):
        along = f"{name}: error along {axis}"
        bench.add(f"{along}, rms, median of runs", np.median(rms[:, column]), "mm")
        bench.add(f"{along}, rms, worst run", rms[:, column].max(), "mm", "< 1")
        bench.add(f"{along}, largest", worst[:, column].max(), "mm")
    missed = sum(one["missed"] for one in told)
    bench.add(f"{name}: looks that found nothing", missed)
