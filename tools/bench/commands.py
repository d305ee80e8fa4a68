"""The start of commands: their processor time."""

from __future__ import annotations

import resource
import subprocess
import sys
from pathlib import Path

import numpy as np

SCRIPTS = Path(__file__).resolve().parents[2] / "scripts"
LOOP = (sys.executable, "-c", "for _ in range(10**7): pass")
COMMANDS = {
    "check --help": "<= 0.6",
    "check squat.csv": "<= 0.9",
    "motion info squat.csv": "<= 0.6",
    "pose --help": "<= 0.4",
    "play --help": "<= 0.4",
}
"""What is promised of each, relative to the loop."""


def commands(bench):
    """Processor time of commands, relative to ten million turns of a loop of Python.

    Medians; each run is divided by a run of `for _ in range(10**7): pass` just before.
    """
    found = {name: [] for name in COMMANDS}
    loops = []
    for _ in range(bench.length(9, 3)):
        loops.append(_seconds(LOOP))
        for name in COMMANDS:
            script, *words = name.split()
            spent = _seconds((sys.executable, str(SCRIPTS / script), *words))
            found[name].append(spent / loops[-1])
    for name, values in found.items():
        bench.add(name, np.median(values), "loops", COMMANDS[name])
    bench.add("the loop", np.median(loops), "s")


def _seconds(command):
    """Run a command; return its processor time in [s]."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
