"""From a robot's description to its body in PyBullet, in processor time.

What the stand-in does at its start: the description is read, the height found at which
the robot stands, and its body made in hold. The first time is that of a process that
has read no mesh before; later ones are what a further spawn or a new mass costs.
"""

import time

import numpy as np

from g1_description.files.uris import with_absolute_uris
from g1_description.robot.lumping import lump_fixed_joints
from g1_description.robot.urdf import parse_urdf
from g1_description.sim.standing import standing_height
from g1_description.sim.world import World

from .start_up import measure_models

RUNS = 9
UPRIGHT = np.array([0.0, 0.0, 0.0, 1.0])


def run(bench):
    """Load the package's model, and the vendor's where it is here."""
    measure_models(bench, measure, "<= 0.6")


def measure(bench, name, model, target=""):
    """Time the loading of one model."""
    with bench.attempt(name):
        text = with_absolute_uris(model.read_text(encoding="utf-8"), model.parent)
        first, *others = [load(text) for _ in range(bench.count(RUNS, 3))]
        again = np.median(others, axis=0)
        bench.add(f"{name}: reading it", again[0], "s")
        bench.add(f"{name}: height, the first time", first[1], "s")
        bench.add(f"{name}: spawn, the first time", first[2], "s")
        bench.add(f"{name}: both, the first time", sum(first[1:]), "s", target)
        bench.add(f"{name}: both again, median", sum(again[1:]), "s")


def load(text):
    """Load a robot; return processor times of reading, height and spawn in [s]."""
    times = [time.process_time()]
    robot = lump_fixed_joints(parse_urdf(text))
    times.append(time.process_time())
    height = standing_height(robot, UPRIGHT)
    times.append(time.process_time())
    world = World("hold")
    world.spawn("robot", robot, np.array([0.0, 0.0, height, *UPRIGHT]))
    times.append(time.process_time())
    world.close()
    return np.diff(times).tolist()
