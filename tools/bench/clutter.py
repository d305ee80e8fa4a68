"""Inverse kinematics among objects: hands in clutters that they can reach into."""

from __future__ import annotations

import time

import numpy as np

from g1_description import Scene
from g1_description.collisions.obstacles import Obstacles
from g1_description.ik.inverse_kinematics import InverseKinematics
from g1_description.ik.options import IkOptions

from .ik import HANDS, random_stands, step_times

COUNT = 20
CLEARANCE = 0.003  # [m] of the objects at the start and the configuration to be found
SPREAD = 0.2  # [m]


def clutter(bench):
    """Both hands to poses among 20 boxes, cylinders and spheres around them.

    The targets are those of random configurations without collisions, in which the feet
    stand as at the start. Objects are drawn around both hands, so that they touch
    neither that configuration nor the start. A depth is that of the deepest link in an
    object, measured afterwards.
    """
    robot = bench.robot
    start = robot.named_configuration("stand")
    base = np.array([0.0, 0.0, 0.7634, 0, 0, 0, 1])
    with bench.attempt("clutters"):
        made = _clutters(robot, start, base, bench.length(100, 6))
    for hands in (HANDS[:1], HANDS):
        with bench.attempt(f"{len(hands)} hands"):
            _reach(bench, made, hands, start, base)
    for avoids in (False, True):
        with bench.attempt("steps"):
            _steps(bench, made[:20], start, base, avoids)


def _clutters(robot, start, base, count):
    """Make scenes, with the poses of the links that can be reached in them."""
    random, made = np.random.default_rng(0), []
    for found in random_stands(robot, start, base, random):
        if len(robot.self_collisions(found.positions, found.base).sample):
            continue
        both = np.stack([found.positions, start]), np.stack([found.base, base])
        poses = robot.link_poses(found.positions, found.base)
        hands = [poses[robot.profile.links[hand]] for hand in HANDS]
        drawn = Scene()
        for number in range(5 * COUNT):
            _draw(drawn, random, number, hands[number % 2][:3])
        links = robot.forward_kinematics(*both)
        free = _apart(robot, drawn, links, CLEARANCE)
        if len(free) >= COUNT:
            scene = Scene([drawn[name] for name in free[:COUNT]])
            made.append((scene, dict(zip(HANDS, hands))))
        if len(made) == count:
            return made


def _draw(scene, random, number, place):
    """Add a box, cylinder or sphere near a place."""
    at = place + SPREAD * random.normal(size=3)
    turn, name = random.uniform(-np.pi, np.pi, 3), f"object_{number}"
    kind = number % 3
    if kind == 0:
        scene.box(name, random.uniform(0.03, 0.2, 3), at, rpy=turn)
    elif kind == 1:
        size = random.uniform([0.02, 0.05], [0.08, 0.3])
        scene.cylinder(name, *size, at, rpy=turn)
    else:
        scene.sphere(name, random.uniform(0.02, 0.1), at)


def _apart(robot, scene, links, margin):
    """List the objects that no link is near."""
    obstacles = Obstacles(robot.description, scene)
    near = obstacles.contacts_among(links, _poses(scene), margin)
    touched = {obstacles.pairs[pair][1] for pair in near.pair}
    return [name for name in scene if name not in touched]


def _poses(scene):
    return np.array([each.pose for each in scene.values()])


def _reach(bench, made, hands, start, base):
    """Reach all targets."""
    robot, times, steps, depths, reached, unaware = bench.robot, [], [], [], 0, 0
    for scene, targets in made:
        target = {hand: targets[hand] for hand in hands}
        options = {"avoid_collisions": True, "scene": scene}
        begin = time.process_time()
        result = robot.ik(target, start, base, **options)
        times.append(time.process_time() - begin)
        steps.append(result.steps)
        reached += result.reached
        depths.append(_depth(robot, scene, result))
        without = robot.ik(target, start, base, avoid_collisions=True)
        unaware += _depth(robot, scene, without) > 1e-3
    what = f"{len(hands)} hand{'s' * (len(hands) > 1)}"
    share = 100.0 / len(made)
    bench.add(f"{what}: reached", share * reached, "%", ">= 90")
    bench.add(f"{what}: deepest", 1e3 * max(depths), "mm", "<= 1")
    bench.add(f"{what}: in collision without the scene", share * unaware, "%")
    bench.add_times(f"{what}: time", times)
    bench.add(f"{what}: steps, median", np.median(steps))
    bench.add(f"{what}: steps, 99th percentile", np.percentile(steps, 99))


def _depth(robot, scene, result):
    """Measure the depth of the deepest link, in [m]."""
    links = robot.forward_kinematics(result.positions, result.base)[np.newaxis]
    found = Obstacles(robot.description, scene).contacts_among(links, _poses(scene))
    return max(0.0, -float(found.distance.min(initial=0.0)))


def _steps(bench, made, start, base, avoids):
    """Measure single steps with both hands and balance."""
    robot, times = bench.robot, []
    inverse = InverseKinematics(robot.description, lambda: robot.checker().collisions)
    for scene, target in made:
        given = scene if avoids else None
        options = IkOptions(balance=True, avoid_collisions=True, scene=given)
        times += step_times(inverse, target, start, base, options)
    name = f"a step with {COUNT if avoids else 'no'} objects"
    bench.add_times(name, times)
