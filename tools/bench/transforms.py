"""TF on a busy machine, through resets and a pause.

One busy process per core runs beside the display with RViz on a virtual screen,
tf_echo, and a plain rospy node. The node moves base and joints fifty times a second,
resets the world, pauses it for a second, and looks up map -> left_wrist_yaw_link with a
tf2_ros listener. A time runs from the service's answer until the second transform after
the reset or the pause. A second run, without RViz, resets twenty times. Trouble means
lines about repeated or old data, on /rosout, on a console or in a log.
"""

import sys
from pathlib import Path

from .nodes import Graph, wait_for

HERE = Path(__file__).resolve().parent
TROUBLE = ("TF_REPEATED_DATA", "TF_OLD_DATA")
SECONDS = 60.0
RESETS = 20
APART = 3.0  # [s] from one of many resets to the next
LONGEST = 400.0  # [s]
ECHO = ("rosrun", "tf", "tf_echo", "map", "left_wrist_yaw_link")


def run(bench):
    """Watch TF with RViz, then reset again and again without."""
    seconds = bench.seconds(SECONDS, 15.0)
    measure(bench, "RViz", seconds, 2, 1)
    resets = bench.count(RESETS, 4)
    measure(bench, "many resets", APART * resets, resets, 0)


def measure(bench, name, seconds, resets, pauses):
    """Run once, and keep the figures."""
    what = f"{name}: {resets} resets and {pauses} pauses in {seconds:.0f} s"
    with bench.attempt(what), Graph() as graph:
        if pauses:
            graph.launch_rviz(bench.model)
            graph.node("/rviz")
        else:
            graph.launch(bench.model)
        graph.node("/robot_state_publisher")
        echo = graph.start(ECHO)
        graph.keep_busy()
        node = (sys.executable, HERE / "tf_node.py", seconds, resets, pauses)
        told = graph.start(node).result(LONGEST)
        echo.check()
        if pauses:
            listeners = dict(graph.master.getSystemState()[1])["/tf"]
            wait_for(lambda: "/rviz" in listeners, "RViz on /tf", 0.1)
        report(bench, name, told, graph.consoles())


def report(bench, name, told, consoles):
    """Keep the figures of a run."""
    lines = [line for line in consoles.splitlines() if any(w in line for w in TROUBLE)]
    # What was on /rosout is in what the node printed of it, too.
    lines = [line for line in lines if not line.startswith("{")]
    for line in [*told["trouble"], *lines][:10]:
        bench.say(line)
    bench.add(f"{name}: lines of trouble on /rosout", len(told["trouble"]), "", "= 0")
    bench.add(f"{name}: lines of trouble elsewhere", len(lines), "", "= 0")
    for kind, after in (("reset", "reset"), ("pause", "going on")):
        times = told[kind]
        if times:
            bench.say(f"after {after}: {', '.join(f'{t:.3f}' for t in times)} s")
            bench.add(f"{name}: {after} to TF, longest", max(times), "s", "< 0.5")
