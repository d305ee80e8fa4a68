"""The command pose, repeatedly, while all cores are busy.

One busy process per core runs beside the default display. A call ends when the joint
states show the pose, or when it gives up; every other call moves smoothly for a second.
Its time runs from starting rosrun to its end and includes the start of Python.
"""

import subprocess
import time
from itertools import cycle, islice

import numpy as np

from .nodes import Graph, wait_for

CALLS = 100
LONGEST = 300.0  # [s] that a call may take
WORDS = (
    ("squat",),
    ("zero", "--seconds", "1"),
    ("wave",),
    ("t_pose", "--seconds", "1"),
    ("zero",),
    ("sit", "--seconds", "1"),
)


def run(bench):
    """Call it, and count the calls that gave up."""
    calls = bench.count(CALLS, 6)
    with bench.attempt(f"{calls} calls with all cores busy"), Graph() as graph:
        graph.launch(bench.model)
        for name in ("/gazebo", "/link_states_bridge"):
            wait_for(lambda name=name: graph.finds(name), f"the node {name}")
        graph.keep_busy()
        tried = []
        for words in islice(cycle(WORDS), calls):
            tried.append(call(bench, words))
            if len(tried) % 10 == 0:
                bench.say(f"{len(tried)} calls")
        times, gave_up = np.array(tried).T
        bench.add("calls", calls)
        bench.add("calls that gave up", gave_up.sum(), "", "= 0")
        bench.add("time of a call, median", np.median(times), "s")
        bench.add("time of a call, longest", times.max(), "s")


def call(bench, words):
    """Call it once; give its time in [s], and whether it gave up."""
    start = time.monotonic()
    done = subprocess.run(
        ["rosrun", "g1_description", "pose", *words],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        timeout=LONGEST,
        text=True,
    )
    if done.returncode:
        bench.say(f"pose {' '.join(words)}: {done.stdout.strip()}")
    return time.monotonic() - start, done.returncode != 0
