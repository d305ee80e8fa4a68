"""What the node checker takes of a core, and how fast it answers check_state.

The robot stands, then plays a motion of all joints and the base, then somebody listens
to the markers, too: RViz would. Calls come from one process over one connection, one
after the other, for a robot that stands and for random configurations near it: to a
checker alone, then to one that judges a robot as well, whose simulator and bridge work
beside it.
"""

import sys
import tempfile
from pathlib import Path

from g1_description.motion.files.write import write_motion
from g1_description.robot.load import absolute_urdf
from g1_description.robot.urdf import parse_urdf

from .checks import RATE, clip
from .nodes import Graph

HERE = Path(__file__).resolve().parent
SECONDS = 20.0
CLIP = 30.0  # [s]
NODE = "/checker"
GRACE = 60.0  # [s]


def run(bench):
    """Measure the service, then live checks."""
    seconds = bench.seconds(SECONDS, 3.0)
    with bench.attempt("check_state of a checker alone"), Graph() as graph:
        text = absolute_urdf(str(bench.model))
        graph.master.setParam("/robot_description", text)
        graph.start(["rosrun", "g1_description", "checker.py", "_rate:=0"])
        graph.node(NODE)
        calls(bench, graph, "", seconds)
    with bench.attempt("live checks at 30 Hz"):
        live(bench, seconds)


def live(bench, seconds):
    """Keep the figures of a display."""
    with tempfile.TemporaryDirectory() as folder, Graph() as graph:
        graph.launch(bench.model, "checks:=true")
        node = graph.node(NODE)
        calls(bench, graph, "beside a simulator, ", seconds)
        share(bench, graph, node, "robot at rest", seconds)
        motion = Path(folder) / "clip.csv"
        robot = parse_urdf(absolute_urdf(str(bench.model)))
        write_motion(motion, clip(robot, 1, round(CLIP * RATE)), robot)
        graph.start(["rosrun", "g1_description", "play", motion, "--loop"])
        share(bench, graph, node, "robot moving", seconds, "moving")
        share(bench, graph, node, "robot moving, with markers", seconds, "markers")


def calls(bench, graph, where, seconds):
    """Keep how many calls the service answers."""
    for case, rate in run_node(graph, "calls", seconds).items():
        target = "" if where else ">= 300"
        bench.add(f"check_state, {where}{case}", rate, "1/s", target)


def share(bench, graph, node, what, seconds, case="rest"):
    """Keep which share of a core the node takes, and how many states it judges."""
    seen = run_node(graph, case, seconds, node.pid)
    bench.add(f"{what}: share of a core", 100.0 * seen["share"], "%", "< 10")
    bench.add(f"{what}: states judged", seen["judged"], "1/s")


def run_node(graph, *arguments):
    """Give what the process said that calls and listens."""
    command = [sys.executable, HERE / "checker_node.py", *arguments]
    return graph.start(command).result(4.0 * SECONDS + GRACE)
