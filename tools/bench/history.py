"""The bridge's history: memory of ten minutes, and time to add and to read states."""

from __future__ import annotations

import os
import time
from dataclasses import replace

import numpy as np

from g1_description.bridge.estimator import JointStateEstimator
from g1_description.motion.history import History
from g1_description.robot.assembly import SCOPE

from .graph import Process

MODEL = "g1_robot"
RATE, SECONDS = 200, 600
BLOCK = 2000  # states whose links are placed at once


def kept(bench):
    """Let all joints and the base move for ten minutes, and keep what is measured."""
    count = RATE * bench.length(SECONDS, 60)
    for what, extra in (
        ("kinematic", False),
        ("hold, with efforts and commands", True),
    ):
        with bench.attempt(what):
            _keep(bench, what, _measured(bench.robot, count, extra))


def _measured(robot, count, extra):
    """Measure states as the bridge does; ``extra`` adds efforts and commands."""
    random, joints = np.random.default_rng(1), len(robot.joint_names)
    middle, reach = 0.5 * (robot.lower + robot.upper), robot.upper - robot.lower
    size = reach * random.uniform(0.1, 0.45, joints)
    phase, speed = random.uniform(0.0, 6.3, joints), random.uniform(0.5, 6.0, joints)
    estimator = JointStateEstimator({MODEL: robot.description})
    links = tuple(f"{MODEL}{SCOPE}{link}" for link in robot.link_names)
    for begin in range(0, count, BLOCK):
        t = (begin + np.arange(BLOCK)[:, np.newaxis]) / RATE
        angle = phase + speed * t
        positions, base = middle + size * np.sin(angle), np.zeros((BLOCK, 7))
        base[:, :3] = 0.5 * np.sin([0.1, 0.13, 0.2] * t) + [0.0, 0.0, 0.8]
        base[:, 5:6], base[:, 6:] = np.sin(0.1 * t), np.cos(0.1 * t)
        poses = robot.forward_kinematics(positions, base)
        velocities, twists = size * speed * np.cos(angle), 0.1 * np.cos(phase[:6] + t)
        still = np.zeros((len(links), 6))
        efforts = 40.0 * np.sin(angle) + random.normal(0.0, 0.5, angle.shape)
        for row in range(min(BLOCK, count - begin)):
            stamp = 1_000_000_000 * (begin + row + 1) // RATE
            (state,) = estimator.update(links, poses[row], still, stamp)
            state = replace(state, velocities=velocities[row], base_twist=twists[row])
            if extra:
                command = dict(zip(state.names, positions[row].tolist()))
                state = replace(state, commanded=command, commanded_base=base[row])
                state = replace(state, efforts=efforts[row])
            yield state


def _keep(bench, what, states):
    """Keep states, and read them."""
    history, process, added, packed = History(SECONDS), Process(os.getpid()), 0.0, 0.0
    before = process.memory()
    for count, state in enumerate(states, 1):
        begin = time.thread_time()
        history.add(state)
        added += time.thread_time() - begin
        if count % 4 == 0:  # as often as the bridge does its housekeeping
            begin = time.thread_time()
            history.pack()
            packed += time.thread_time() - begin
    first, last = history.runs()[1]
    bench.add(f"{what}: memory", history.n_bytes / 1e6, "MB", "<= 60", "-")
    bench.add(f"{what}: growth of the process", process.memory() - before, "MB")
    bench.add(f"{what}: kept", (last - first) / 1e9, "s")
    bench.add(f"{what}: to add a state", 1e6 * added / count, "us")
    bench.add(f"{what}: to compress a state", 1e6 * packed / count, "us")
    for name, asked, most in (
        ("one state", np.linspace(first, last, 200).astype(int).tolist(), 0),
        ("1000 states of all", [None], 1000),
        ("all states", [None], 0),
    ):
        begin = time.thread_time()
        for stamp in asked:
            one = (stamp, stamp) if stamp else (first, last)
            history.stretch(*one, most)
        spent = (time.thread_time() - begin) / len(asked)
        bench.add(f"{what}: to read {name}", 1e3 * spent, "ms")
