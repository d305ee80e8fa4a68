"""Smooth trajectories: random paths of both hands, and impossible ones."""

from __future__ import annotations

import time

import numpy as np

from g1_description import TrajectoryBounds
from g1_description.ik.inverse_kinematics import InverseKinematics
from g1_description.ik.options import IkOptions
from g1_description.robot.rotation import (
    conjugate,
    from_rotation_vector,
    multiply,
    to_rotation_vector,
)

HANDS, FEET = ("left_hand", "right_hand"), ("left_foot", "right_foot")
OPTIONS = {"balance": True, "avoid_collisions": True, "floor": 0.0}
REACHED = 0.002
BRANCH = 0.2
"""Change of a joint or the base in 20 ms that is another configuration, in [rad]."""

CHECKS = ("jump", "base_jump", "position", "velocity", "skating", "drift")


def trajectories(bench):
    """Paths of both hands, with balance, floor and distances, 50 samples per second.

    They are those of random motions through three keyframes, whose feet stay and which
    pass the check with a margin of 30 mm, so all can be followed. Quick ones are their
    second halves at 2.5 times the speed, begun standing. Those that cannot be followed
    are the same with the left hand 0.7 to 1 m farther for a third of the time, or in a
    thirtieth of the time.
    """
    robot = bench.robot
    standing = robot.named_configuration("stand")
    base = np.array([0.0, 0.0, 0.7634, 0, 0, 0, 1])
    robot.ik({}, standing, base, **OPTIONS)  # prepares the shapes
    inverse = InverseKinematics(robot.description, lambda: robot.checker().collisions)
    random = np.random.default_rng(0)
    with bench.attempt("motions"):
        known = [
            _motion(robot, inverse, random, standing, base)
            for _ in range(bench.length(200, 4))
        ]
    with bench.attempt("paths that can be followed"):
        paths = [_targets(robot, motion) for motion in known]
        _follow(bench, "random paths", paths, standing, base)
    with bench.attempt("paths that are quick"):
        _follow(bench, "quick paths", [_quick(*path) for path in paths], standing, base)
    with bench.attempt("paths that cannot"):
        hard = [_hard(random, *path) for path in paths[: bench.length(50, 4)]]
        _follow(bench, "impossible paths", hard, standing, base)
    with bench.attempt("samples of two hands"):
        times = np.arange(900) * 0.02
        shares = np.linspace(0.0, 1.0, 900)
        at, targets = paths[0]
        slow = {
            name: np.stack([np.interp(shares, at / at[-1], c) for c in rows.T], axis=1)
            for name, rows in targets.items()
        }
        for rows in slow.values():
            rows[:, 3:] /= np.linalg.norm(rows[:, 3:], axis=1, keepdims=True)
        begin = time.process_time()
        robot.ik_trajectory(times, slow, standing, base, **OPTIONS)
        spent = time.process_time() - begin
        bench.add("900 samples of two hands", spent, "s", "< 5")


def _motion(robot, inverse, random, standing, base):
    """Make a motion through random keyframes that passes the check."""
    options = IkOptions(**OPTIONS)
    while True:
        frames = [(standing, base)]
        while len(frames) < 3:
            posture = standing + random.uniform(-0.6, 0.6, len(standing))
            posture[:12] = standing[:12]
            moved = base.copy()
            moved[:3] += random.uniform([-0.02, -0.05, -0.3], [0.05, 0.05, -0.02])
            moved[3:] = from_rotation_vector(random.uniform(-0.15, 0.15, 3))
            found = inverse.solve({"pelvis": moved}, posture, base, options, 1)
            if found.reached:
                frames.append((found.positions, found.base))
        seconds = np.cumsum(random.uniform([0.0, 2.0, 2.0], [0.0, 4.0, 4.0]))
        motion = robot.keyframes(frames, seconds.round(2)).motion
        verdict = robot.check(motion)
        if verdict.passed and verdict.figures["least_center_margin"] > 0.03:
            return motion


def _targets(robot, motion):
    """Return times, and poses of both hands by name."""
    poses = robot.link_poses(motion.positions, motion.base_poses)
    return motion.times, {hand: poses[robot.profile.links[hand]] for hand in HANDS}


def _quick(times, targets):
    """Take every third sample of the second half, at 2.5 times the speed."""
    middle = len(times) // 2
    kept = {name: rows[middle::3] for name, rows in targets.items()}
    return 0.4 * (times[middle::3] - times[middle]), kept


def _hard(random, times, targets):
    """Make a path that cannot be followed."""
    if random.random() < 0.3:
        return times / 30.0, targets
    far = {name: rows.copy() for name, rows in targets.items()}
    third = len(times) // 3
    bump = np.sin(np.linspace(0.0, np.pi, third)) ** 2 * random.uniform(0.7, 1.0)
    far["left_hand"][third : 2 * third, 0] += bump
    return times, far


def _follow(bench, what, paths, standing, base):
    """Follow paths with balance, floor and distances."""
    robot, limits = bench.robot, TrajectoryBounds()
    reached = named = samples = 0
    spent, found = 0.0, []
    used = {"speed": 0.0, "acceleration": 0.0}
    changed = moved = 0.0
    for times, targets in paths:
        begin = time.process_time()
        path = robot.ik_trajectory(times, targets, standing, base, **OPTIONS)
        spent += time.process_time() - begin
        samples += len(times)
        errors = [one.errors[hand].position for one in path.results for hand in HANDS]
        reached += max(errors) <= REACHED
        named += "hand" in path.message
        feet = [one.errors[foot].position for one in path.results for foot in FEET]
        moved = max(moved, *feet)
        motion = path.motion
        places, rotations = motion.base_poses[:, :3], motion.base_poses[:, 3:]
        turns = to_rotation_vector(multiply(rotations[1:], conjugate(rotations[:-1])))
        moves = np.diff(places, axis=0), turns, np.diff(motion.positions, axis=0)
        pace = np.diff(times)[:, np.newaxis]
        speeds = np.hstack(moves) / pace
        changes = np.diff(speeds, axis=0) / pace[1:]
        fastest = np.repeat([limits.base_speed, limits.base_turn_rate], 3)
        quickest = [limits.base_acceleration, limits.base_turn_acceleration]
        joints = np.full(len(standing), limits.joint_acceleration)
        fastest = np.append(fastest, robot.velocity_limits)
        quickest = np.append(np.repeat(quickest, 3), joints)
        used["speed"] = max(used["speed"], (np.abs(speeds) / fastest).max())
        share = (np.abs(changes) / quickest).max()
        used["acceleration"] = max(used["acceleration"], share)
        changed = max(changed, 0.02 * np.abs(speeds[:, 3:]).max())
        found += robot.check(motion, only=CHECKS).findings
    bench.add(f"{what}", len(paths))
    can = not what.startswith("impossible")
    promise = ">= 95" if can else ""
    bench.add(
        f"{what}: reached within 2 mm", 100.0 * reached / len(paths), "%", promise
    )
    if not can:
        share = 100.0 * named / len(paths)
        bench.add(f"{what}: message names the hand", share, "%", ">= 100")
    for name, share in used.items():
        bench.add(f"{what}: largest {name} of its bound", 100.0 * share, "%", "<= 100")
    bench.add(f"{what}: most in 20 ms", changed, "rad", f"< {BRANCH}" if can else "")
    bench.add(f"{what}: feet moved, most", 1e3 * moved, "mm", "< 2" if can else "")
    failed = [one.check for one in found if one.severity == "failed"]
    bench.add(f"{what}: failures of {', '.join(CHECKS)}", len(failed), "", "<= 0")
    bench.add(f"{what}: time per sample", 1e3 * spent / samples, "ms")
