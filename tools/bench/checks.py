"""How many samples per second each kind of check judges, in processor time.

Clips of 30 s at 60 Hz are made up: the robot stands, or sways and swings its arms, with
joints that go to and fro at frequencies of their own. Samples per second are those of
one core. How the cost grows is the time per sample of clips of many lengths, and
``--jobs`` is measured by the clock, beside what two processes get that only compute:
the cores of a machine may share one.
"""

from __future__ import annotations

import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from g1_description.checks.checker import Checker
from g1_description.motion.files.write import write_motion
from g1_description.motion.motion import Motion
from g1_description.motion.trajectory import Trajectory
from g1_description.robot.load import absolute_urdf
from g1_description.robot.urdf import parse_urdf
from g1_description.sim.floor import lowest_height

from .nodes import MeasurementError

KINDS = {
    "limits and jumps": ("position", "velocity", "jump", "base_jump"),
    "self-collision": ("self_collision",),
    "floor": ("penetration", "skating"),
    "floor and balance": ("floating", "center_of_mass", "zero_moment_point"),
    "all": (),
}
RATE = 60.0  # [Hz]
SECONDS = 30.0
CLIPS = 60
LENGTHS = (900, 3600, 14_400, 57_600)
SPIN = "for _ in range(60_000_000): pass"


def clip(robot, seed, n_samples):
    """Make up a motion, whose feet stay near the floor."""
    rng = np.random.default_rng(seed)
    joints, times = robot.movable_joints, np.arange(n_samples) / RATE
    ranges = np.array([min(j.upper - j.lower, 3.0) for j in joints])
    is_leg = np.array(["hip" in j.name or "knee" in j.name for j in joints])
    size = np.where(is_leg, 0.03, 0.12) * ranges * rng.uniform(0.3, 1.0, len(joints))
    rate, phase = rng.uniform(0.5, 3.0, len(joints)), rng.uniform(0, 6, len(joints))
    positions = size * np.sin(rate * times[:, np.newaxis] + phase)
    base = np.tile([0.0, 0.0, 0.79, 0.0, 0.0, 0.0, 1.0], (n_samples, 1))
    names = tuple(joint.name for joint in joints)
    motion = Trajectory(times, names, positions, base_poses=base)
    base[:, 2] -= lowest_height(robot, motion)
    return Trajectory(times, names, positions, base_poses=base)


def run(bench):
    """Measure kinds of checks, lengths of clips, memory, and two processes."""
    robot = parse_urdf(absolute_urdf(str(bench.model)))
    begin = time.process_time()
    checker = Checker(robot)
    bench.add("reading the robot", time.process_time() - begin, "s")
    n_clips = bench.count(CLIPS, 3)
    clips = [clip(robot, seed, round(SECONDS * RATE)) for seed in range(n_clips)]
    for kind, names in KINDS.items():
        bench.say(kind)
        rate = samples_per_second(checker, clips, names)
        bench.add(f"{kind}: {n_clips} clips", rate, "samples/s")
    for length in LENGTHS[: bench.count(len(LENGTHS), 2)]:
        bench.say(f"{length} samples")
        rate = samples_per_second(checker, [clip(robot, 1, length)], ())
        bench.add(f"all: one clip of {length} samples", rate, "samples/s")
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0
    bench.add("memory of this process at most", memory, "MB", "< 500")
    with bench.attempt("two processes"):
        jobs(bench, robot, clips)


def samples_per_second(checker, clips, names):
    """Judge clips; return samples per second of processor time."""
    begin = time.process_time()
    for motion in clips:
        checker.check(Motion(motion), names)
    return sum(len(motion.times) for motion in clips) / (time.process_time() - begin)


def jobs(bench, robot, clips):
    """Compare one process with two, by the clock."""
    with tempfile.TemporaryDirectory() as folder:
        for number, motion in enumerate(clips):
            write_motion(Path(folder) / f"clip_{number:02}.csv", motion, robot)
        seconds = {}
        for n_jobs in (1, 2):
            bench.say(f"--jobs {n_jobs}")
            begin = time.monotonic()
            check(folder, n_jobs)
            seconds[n_jobs] = time.monotonic() - begin
            bench.add(f"check --jobs {n_jobs}", seconds[n_jobs], "s")
    bench.add("--jobs 2 beside one", seconds[1] / seconds[2], "times", ">= 1.8")
    bench.add("two that only compute, beside one", ceiling(), "times")


def check(folder, n_jobs):
    """Run the command on a folder; findings are no failure here."""
    command = [Path(__file__).parents[2] / "scripts" / "check", folder]
    command = [sys.executable, *command, "--jobs", str(n_jobs)]
    code = subprocess.run(command, stdout=subprocess.DEVNULL).returncode
    if code not in (0, 1):
        raise MeasurementError(f"check ended with {code}")


def ceiling():
    """Tell how much more two processes compute than one, in the same time."""
    times = []
    for n_processes in (1, 2):
        begin = time.monotonic()
        spinning = [
            subprocess.Popen([sys.executable, "-c", SPIN]) for _ in range(n_processes)
        ]
        for process in spinning:
            process.wait()
        times.append(time.monotonic() - begin)
    return 2.0 * times[0] / times[1]
