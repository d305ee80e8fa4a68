"""Mended motions: clean ones that were spoilt, and those that are there."""

from __future__ import annotations

import resource
import time
from dataclasses import replace

import numpy as np

from g1_description.mend.mending import mended

MOTIONS = "squat.csv", "step_in_place.csv", "wave.csv"


def fixes(bench):
    """Motions of this package that are spoilt by known faults, and fixed.

    Distances are those of the links from where they are in the clean motion, rms; they
    should be five times smaller after.
    """
    checker = bench.robot.checker()
    for name in MOTIONS:
        read = bench.robot.read_motion(name)
        for way, spoil in WAYS.items():
            with bench.attempt(f"{name}, {way}"):
                is_raised = spoil is _beyond
                clean = raised(bench.robot, read, 0.0) if is_raised else read
                random = np.random.default_rng(0)
                spoilt = spoil(bench.robot, read, random)
                begin = time.process_time()
                found = mended(checker, spoilt)
                seconds = time.process_time() - begin
                before, after = (
                    distance(bench.robot, clean, motion)
                    for motion in (spoilt, found.motion)
                )
                ratio = before / max(after, 1e-9)
                bench.add(f"{name}, {way}: distance", 1000 * before, "mm before")
                bench.add(f"{name}, {way}: smaller", ratio, "times", ">= 5")
                counts = found.certificate.failures
                bench.add(f"{name}, {way}: failures", counts[1], f"of {counts[0]}")
                speed = seconds / clean.duration
                bench.add(f"{name}, {way}: time", speed, "of real time", "<= 1")
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0
    bench.add("memory", memory, "MB", "<= 300")


def distance(robot, clean, motion):
    """Return the rms distance of links from where they are in another motion."""
    poses = []
    for one in (clean, motion):
        positions = robot.positions_of(one)
        places = robot.link_poses(positions, one.base_poses)
        poses.append(np.stack([place[..., :3] for place in places.values()], axis=-2))
    away = np.linalg.norm(poses[1] - poses[0], axis=-1)
    return float(np.sqrt((away**2).mean()))


def raised(robot, motion, beyond):
    """Let an elbow and a wrist go to their limits for a second, or beyond, in [rad]."""
    positions = motion.positions.copy()
    away = np.abs(motion.times - motion.times.mean())
    share = np.clip(2.0 - 2.0 * away, 0.0, 1.0)
    share = share * share * (3.0 - 2.0 * share)
    joints = {joint.name: joint for joint in robot.description.movable_joints}
    for name in ("left_elbow_joint", "right_wrist_pitch_joint"):
        column, most = motion.joint_names.index(name), joints[name].upper
        bump = positions[:, column] + share * (most - positions[:, column])
        positions[:, column] = bump + beyond * np.clip(1.0 - 2.0 * away, 0.0, 1.0)
    return replace(motion, positions=positions, velocities=None)


def _drifts(robot, motion, random):
    """Let the base drift sideways, 30 mm/s."""
    bases = motion.base_poses.copy()
    bases[:, 1] += 0.03 * (motion.times - motion.times[0])
    return replace(motion, base_poses=bases)


def _slides(robot, motion, random):
    """Let the robot slide forwards by 0.25 m within half a second."""
    bases = motion.base_poses.copy()
    bases[:, 0] += 0.25 * np.clip(
        2.0 * (motion.times - motion.times[0]) - 1.0, 0.0, 1.0
    )
    return replace(motion, base_poses=bases)


def _high(robot, motion, random):
    """Lift all of it by 2 cm."""
    return replace(motion, base_poses=motion.base_poses + 0.02 * np.eye(7)[2])


def _noisy(robot, motion, random):
    """Add noise of 5 mrad to all joints."""
    noise = 0.005 * random.standard_normal(motion.positions.shape)
    return replace(motion, positions=motion.positions + noise, velocities=None)


def _outlier(robot, motion, random):
    """Set one frame of a leg and an arm wrong."""
    positions = motion.positions.copy()
    at = len(positions) // 2
    for name in ("left_knee_joint", "right_elbow_joint"):
        positions[at, motion.joint_names.index(name)] += 0.5
    return replace(motion, positions=positions, velocities=None)


def _beyond(robot, motion, random):
    """Let an elbow and a wrist go up to 0.1 rad beyond their limits."""
    return raised(robot, motion, 0.1)


def _sunk(robot, motion, random):
    """Put the feet 15 mm into the floor for two seconds."""
    bases = motion.base_poses.copy()
    away = np.abs(motion.times - motion.times.mean())
    bases[:, 2] -= 0.015 * np.clip(1.5 - away, 0.0, 0.5) / 0.5
    return replace(motion, base_poses=bases)


WAYS = {
    "drifting": _drifts,
    "sliding 0.25 m": _slides,
    "2 cm too high": _high,
    "noise of 5 mrad": _noisy,
    "one wrong frame": _outlier,
    "beyond limits": _beyond,
    "15 mm in the floor": _sunk,
}
