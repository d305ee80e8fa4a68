"""Inverse kinematics: targets that can be reached, single steps, and pink beside it."""

from __future__ import annotations

import time
from itertools import islice

import numpy as np

from g1_description.ik.inverse_kinematics import InverseKinematics
from g1_description.ik.options import IkOptions
from g1_description.robot.rotation import from_rotation_vector

HANDS, FEET = ("left_hand", "right_hand"), ("left_foot", "right_foot")
TOLERANCE = np.array([1e-3, np.radians(0.5)])


def ik(bench):
    """Both hands to poses that the G1 reaches on its feet, from its standing pose.

    The targets are those of random configurations, with the pelvis up to 0.35 m lower
    and turned by up to 0.3 rad about each axis, in which the feet stand as at the
    start. Steps with four targets are those of both hands, head and pelvis, with
    balance. Beside it is pink, where it is installed, with the same weights and up to
    150 steps of daqp from the same start.
    """
    robot = bench.robot
    start = robot.named_configuration("stand")
    base = np.array([0.0, 0.0, 0.7634, 0, 0, 0, 1])
    with bench.attempt("targets"):
        targets = _targets(robot, start, base, bench.length(2000, 60))
    for balance, collisions, count in (
        (False, False, len(targets)),
        (True, True, len(targets) // 10),
    ):
        what = "balance and distances" if balance else "both hands"
        with bench.attempt(what):
            _reach(bench, what, targets[:count], start, base, balance, collisions)
    for collisions in (False, True):
        with bench.attempt("steps"):
            _steps(bench, targets[:40], start, base, collisions)
    with bench.attempt("pink"):
        _pink(bench, targets[:200], start, base)


def random_stands(robot, start, base, random):
    """Yield random configurations in which the feet stand as at the start."""
    inverse = InverseKinematics(robot.description)
    while True:
        posture = robot.random_configuration(random)
        posture[:12] = start[:12]
        moved = base.copy()
        moved[:3] += random.uniform([-0.15, -0.15, -0.35], [0.15, 0.15, 0.0])
        moved[3:] = from_rotation_vector(random.uniform(-0.3, 0.3, 3))
        result = inverse.solve({"pelvis": moved}, posture, base, IkOptions(), 1)
        if max(max(result.errors[foot]) for foot in FEET) < 1e-5:
            yield result


def _targets(robot, start, base, count):
    """Make poses of both hands, by name."""
    stands = random_stands(robot, start, base, np.random.default_rng(0))
    found = []
    for result in islice(stands, count):
        poses = robot.link_poses(result.positions, result.base)
        found.append({h: poses[robot.profile.links[h]] for h in HANDS})
    return found


def _reach(bench, what, targets, start, base, balance, collisions):
    """Reach all targets."""
    robot, times, steps, reached, feet, beyond = bench.robot, [], [], 0, [], 0
    options = {"balance": balance, "avoid_collisions": collisions}
    robot.ik({}, start, base, **options)  # prepares the shapes
    for target in targets:
        begin = time.process_time()
        result = robot.ik(target, start, base, **options)
        times.append(time.process_time() - begin)
        steps.append(result.steps)
        reached += result.reached
        feet.append(max(result.errors[foot].position for foot in FEET))
        only = ("position",)
        beyond += not robot.check_state(result.positions, result.base, only).passed
    bench.add(f"{what}: targets", len(targets))
    promise = "" if balance else ">= 95"
    bench.add(f"{what}: reached", 100.0 * reached / len(targets), "%", promise)
    bench.add_times(f"{what}: time", times)
    bench.add(f"{what}: steps, median", np.median(steps))
    bench.add(f"{what}: steps, 99th percentile", np.percentile(steps, 99))
    bench.add(f"{what}: feet moved, most", 1e3 * max(feet), "mm", "< 1")
    bench.add(f"{what}: beyond a limit", beyond, "", "<= 0")


def _steps(bench, targets, start, base, collisions):
    """Measure single steps with four targets and balance."""
    robot, times = bench.robot, []
    inverse = InverseKinematics(robot.description, lambda: robot.checker().collisions)
    options = IkOptions(balance=True, avoid_collisions=collisions)
    pelvis = base - [0.0, 0.0, 0.1, 0.0, 0.0, 0.0, 0.0]
    for target in targets:
        wanted = {**target, "head": [0.05, 0.0, 1.1], "pelvis": pelvis}
        times += step_times(inverse, wanted, start, base, options)
    name = f"a step with four targets and balance{' and distances' * collisions}"
    bench.add(
        f"{name}, median", 1e3 * np.median(times), "ms", f"< {15 if collisions else 5}"
    )
    bench.add(f"{name}, 99th percentile", 1e3 * np.percentile(times, 99), "ms")


def step_times(inverse, targets, start, base, options):
    """Measure single steps of a search, in [s] of processor time."""
    steps = inverse.pieces(targets, start, base, options, starts=1, most=1)
    next(steps)  # the start itself
    times, begin = [], time.process_time()
    for _ in islice(steps, 25):
        times.append(time.process_time() - begin)
        begin = time.process_time()
    return times


def _pink(bench, targets, start, base):
    """Reach targets with pink and with us, from one start each."""
    try:
        import pink
        import pinocchio
    except ImportError as error:
        bench.leave_out(f"pink: {error}")
        return
    robot = bench.robot
    inverse = InverseKinematics(robot.description)
    floating = pinocchio.JointModelFreeFlyer()
    model = pinocchio.buildModelFromUrdf(str(bench.model), floating)
    data = model.createData()
    order = [robot.joint_row(name) for name in list(model.names)[2:]]
    first = np.concatenate([base, start[order]])
    counts, times = {"pink": 0, "ours": 0}, {"pink": [], "ours": []}
    for target in targets:
        begin = time.process_time()
        result = inverse.solve(target, start, base, IkOptions(), 1)
        times["ours"].append(time.process_time() - begin)
        counts["ours"] += result.reached
        configuration = pink.Configuration(model, data, first)
        tasks = []
        for name in (*FEET, *HANDS):
            weight = 100.0 if name in FEET else 1.0
            link = robot.profile.links[name]
            task = pink.tasks.FrameTask(link, weight, 0.3 * weight, lm_damping=1e-3)
            task.set_target_from_configuration(configuration)
            if name in target:
                pose = pinocchio.XYZQUATToSE3(target[name])
                task.set_target(pose)
            tasks.append(task)
        posture = pink.tasks.PostureTask(1e-3)
        posture.set_target_from_configuration(configuration)
        tasks.append(posture)
        begin = time.process_time()
        for _ in range(150):
            velocity = pink.solve_ik(
                configuration, tasks, 1.0, "daqp", safety_break=False
            )
            configuration.integrate_inplace(velocity, 1.0)
            errors = [task.compute_error(configuration) for task in tasks[:4]]
            parts = np.linalg.norm(np.reshape(errors, (-1, 2, 3)), axis=-1)
            if (parts < TOLERANCE).all():
                break
        times["pink"].append(time.process_time() - begin)
        counts["pink"] += bool((parts < TOLERANCE).all())
    for name, found in times.items():
        share = 100.0 * counts[name] / len(targets)
        bench.add(f"{name}, one start: reached", share, "%")
        bench.add_times(f"{name}, one start: time", found)
