"""Contact forces of motions, and those of the simulations that made them."""

from __future__ import annotations

import time
from contextlib import closing
from dataclasses import replace

import mujoco
import numpy as np

from g1_description.motion.motion import Motion
from g1_description.robot.lumping import lump_fixed_joints
from g1_description.robot.rotation import multiply, rotate
from g1_description.sim.engine import PhysicsProperties
from g1_description.sim.standing import standing_height
from g1_description.sim.world import World

from .poses import compare_poses

RATES = 30, 50, 120  # [Hz]
LENGTH = 3.0  # [s]
WINDOW = 0.1  # [s] of accelerations, before and after
KINDS = "standing", "squats", "arms", "falls", "hops"
LEGS = {"hip_pitch": -1.0, "knee": 2.0, "ankle_pitch": -1.0}
UP = np.eye(7)[2]
LOWEST = 0.5  # [m] of the base: below it the robot lies
ONLY = ("contact_forces", "penetration", "center_of_mass")


def forces(bench):
    """The check `contact_forces` on motions of MuJoCo, which knows their forces.

    Of each kind there are 10 rollouts: standing with bent legs, squats of 0.3 to 1 Hz,
    arms that swing, falls, and hops; until the robot lies. True forces are means over
    the window of accelerations. Friction is 1 in the simulation and 0.6 in the check.
    Spoilt motions are found if the check, or one of floor and balance, fails.

    Random poses at rest are those of pelvis and arms on two feet, those of all joints
    on one level foot, and those in which a hand or forearm, a knee and a third link
    lie on the floor. What carries them is the convex hull of the points that touch it;
    poses within 2 mm of its edge are left out. hpp-centroidal-dynamics judges 70 of
    each kind where it can be imported.
    """
    compare_poses(bench)
    runs = {}
    for number, kind in enumerate(KINDS):
        with bench.attempt(kind):
            seeds = [[number, each] for each in range(bench.length(10, 1))]
            runs[kind] = [
                _simulated(bench.robot, kind, np.random.default_rng(seed))
                for seed in seeds
            ]
    for rate in RATES:
        with bench.attempt(f"{rate} Hz"):
            _compare(bench, runs, rate)
    with bench.attempt("spoilt motions"):
        _spoil(bench, runs)


def _positions(robot, kind, times, random):
    """Draw a motion of all joints, shape (n, n_joints)."""
    found = np.tile(robot.named_configuration("stand"), (len(times), 1))
    bend = np.full(len(times), random.uniform(0.1, 0.5))
    if kind == "squats":
        rate = random.uniform(0.3, 1.0)
        bend += random.uniform(0.1, 0.35) * (1 - np.cos(2 * np.pi * rate * times))
    if kind == "hops":
        jump = np.clip((times - 1.0) / random.uniform(0.12, 0.2), 0.0, 1.0)
        bend = random.uniform(0.6, 0.8) * (1.0 - jump) + 0.15 * jump
    for side in ("left", "right"):
        for joint, share in LEGS.items():
            found[:, robot.joint_row(f"{side}_{joint}_joint")] = share * bend
    if kind == "arms":
        for side in ("left", "right"):
            row = robot.joint_row(f"{side}_shoulder_pitch_joint")
            rate, size = random.uniform(0.5, 1.5), random.uniform(0.2, 0.6)
            found[:, row] += size * np.sin(2 * np.pi * rate * times)
    if kind == "falls":
        lean = random.uniform(0.2, 0.4) * random.choice([-1.0, 1.0])
        for side in ("left", "right"):
            row = robot.joint_row(f"{side}_ankle_pitch_joint")
            found[:, row] += lean * np.clip(times - 0.5, 0.0, 1.0)
    return found


def _simulated(robot, kind, random):
    """Simulate a motion; return how it went, and the upward force in each step."""
    times, names = np.arange(0.0, LENGTH, 0.02), tuple(robot.joint_names)
    motion = Motion(times, names, _positions(robot, kind, times, random))
    start = dict(zip(names, motion.positions[0].tolist()))
    assembly = replace(lump_fixed_joints(robot.description), positions=start)
    pose = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0])
    pose[2] = standing_height(assembly, pose[3:])
    rows, forces = [], []
    with closing(World("hold", PhysicsProperties(), None, None, "mujoco")) as world:
        world.spawn("g1", assembly, pose)
        model, step = world.model("g1"), world.properties.time_step
        order = [list(model.joint_names).index(name) for name in names]
        world.motions.play(model, motion, world.time_ns)
        for _ in range(round(LENGTH / step)):
            world.advance(1)
            forces.append(_upward(world.engine._model, world.engine._data))
            rows.append(np.append(model.root_poses[0], model.position[order]))
    rows = np.array(rows)
    lies = np.append(np.flatnonzero(rows[:, 2] < LOWEST), len(rows))[0]
    rows = rows[:lies]
    made = Motion(step * np.arange(lies), names, rows[:, 7:], None, rows[:, :7])
    return made, np.array(forces)[:lies]


def _upward(model, data):
    """Add up the upward forces of all contacts with the floor."""
    total, wrench = 0.0, np.zeros(6)
    for number in range(data.ncon):
        contact = data.contact[number]
        mujoco.mj_contactForce(model, data, number, wrench)
        force = contact.frame.reshape(3, 3).T @ wrench[:3]
        total += force[2] if model.geom_bodyid[contact.geom[1]] else -force[2]
    return total


def _compare(bench, runs, rate):
    """Compare forces with those of the simulation."""
    robot, seconds, count = bench.robot, 0.0, 0
    reach = round(WINDOW / 0.001)
    kernel = 1.0 - np.abs(np.arange(-reach, reach + 1)) / reach
    for kind, some in runs.items():
        errors, sizes, shares = [], [], []
        for made, force in some:
            motion = made.resampled(rate)
            begin = time.process_time()
            found = robot.contact_forces(motion)
            seconds, count = (
                seconds + time.process_time() - begin,
                count + len(motion.times),
            )
            mean = np.convolve(force, kernel / kernel.sum(), "same")
            true = np.interp(found.times, made.times, mean)
            up = found.forces[..., 2].sum(axis=1)
            known = ~np.isnan(up)
            errors.append((up - true)[known])
            sizes.append(true[known])
            shares.append(found.missing_share[known])
        error, true, share = map(np.concatenate, (errors, sizes, shares))
        rms = np.sqrt(np.mean(error**2) / np.mean(true**2))
        name = f"{kind}, {rate} Hz"
        bench.add(f"{name}: vertical force, rms error", 100 * rms, "%", "<= 10")
        bench.add(
            f"{name}: missing, 99 %", 100 * np.percentile(share, 99), "% of weight"
        )
        bench.add(f"{name}: missing, largest", 100 * share.max(), "% of weight")
    bench.add(f"{rate} Hz: forces alone", 1e6 * seconds / count, "us per sample")


def _spoil(bench, runs):
    """Lift, tip and hurry motions at 50 Hz."""
    checker = bench.robot.checker()
    ways = {
        "as they are": lambda motion: motion,
        "lifted by 3 cm": lambda m: replace(m, base_poses=m.base_poses + 0.03 * UP),
        "tipped forwards": lambda motion: _tipped(motion, [0.0, 1.0, 0.0]),
        "tipped backwards": lambda motion: _tipped(motion, [0.0, -1.0, 0.0]),
        "tipped sideways": lambda motion: _tipped(motion, [1.0, 0.0, 0.0]),
        "at double speed": lambda motion: motion.at_speed(2.0),
    }
    for way, spoilt in ways.items():
        found, any_check, count = 0, 0, 0
        for some in runs.values():
            for made, _ in some:
                verdict = checker.check(spoilt(made.resampled(50.0)), ONLY)
                failed = {f.check for f in verdict.findings if f.severity == "failed"}
                found += "contact_forces" in failed
                any_check += bool(failed)
                count += 1
        bench.add(f"{way}: failures of contact_forces", found, f"of {count}")
        bench.add(f"{way}: failures of any of the three", any_check, f"of {count}")


def _tipped(motion, axis):
    """Turn a motion by 5 degrees about an axis on the floor, below the robot."""
    half = np.radians(5.0) / 2.0
    turn = np.append(np.sin(half) * np.array(axis), np.cos(half))
    turn = np.tile(turn, (len(motion.times), 1))
    places = rotate(turn, motion.base_poses[:, :3])
    turns = multiply(turn, motion.base_poses[:, 3:])
    return replace(motion, base_poses=np.concatenate([places, turns], axis=1))
