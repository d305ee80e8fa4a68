"""Reads motions, each in a process with little memory and time, and prints the outcome.

Run as ``python limited.py ROBOT FILE...`` with the package on PYTHONPATH. Prints a line
of JSON for each file: what the reader said, seconds of processor time, and bytes.
"""

import json
import os
import resource
import sys
from pathlib import Path

from g1_description.errors import MotionError
from g1_description.motion.files.formats import read_motion
from g1_description.robot.load import read_model

MEMORY = 1_000_000_000
SECONDS = 5


def read(path, robot):
    """Read a file; return what is said of it."""
    try:
        motion = read_motion(path, robot)
    except MotionError as error:
        return str(error)
    return f"{len(motion.times)} samples"


def main():
    """Read all files, each in a fork."""
    robot = read_model(sys.argv[1]).description
    for file in sys.argv[2:]:
        sys.stdout.flush()
        child = os.fork()
        if child:
            os.waitpid(child, 0)
            continue
        resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
        resource.setrlimit(resource.RLIMIT_CPU, (4 * SECONDS, 4 * SECONDS))
        sentence = read(Path(file), robot)
        used = resource.getrusage(resource.RUSAGE_SELF)
        seconds = used.ru_utime + used.ru_stime
        print(json.dumps([Path(file).name, sentence, seconds, used.ru_maxrss * 1024]))
        sys.stdout.flush()
        os._exit(0)


main()
