"""First causes of falls: simulated faults of known kinds, and runs without one."""

from __future__ import annotations

import time
from contextlib import closing
from dataclasses import replace

import numpy as np

from g1_description.motion.history import CommandStream
from g1_description.motion.history_chunks import Command, Stretch
from g1_description.motion.motion import Motion, sample
from g1_description.motion.motors import Motors, PdMotor, ServoMotor, motors_of
from g1_description.robot.lumping import lump_fixed_joints
from g1_description.sim.engine import PhysicsProperties
from g1_description.sim.forces import Span
from g1_description.sim.standing import standing_height
from g1_description.sim.world import World

KINDS = (
    "weak motor",
    "wrong gain",
    "jump",
    "slippery floor",
    "push",
    "base too high",
    "heavy hand",
    "late stream",
)
LENGTH, STEP, ROW = 6.0, 0.001, 5  # [s], and steps per state
PERIOD = 0.02  # [s] of commands
SENDER = "/planner"
SIDES = "left", "right"
LEGS = {"hip_pitch": -1.0, "knee": 2.0, "ankle_pitch": -1.0}
WEAK = (
    ("{}_knee_joint", 15.0),
    ("{}_hip_roll_joint", 10.0),
    ("{}_ankle_pitch_joint", 4.0),
    ("waist_pitch_joint", 3.0),
    ("{}_shoulder_pitch_joint", 0.6),
    ("{}_elbow_joint", 0.6),
)
"""Joints, and efforts in [N m] that are too small for them."""
ERROR, TURNED = 0.2, 0.3  # [rad]
TRIES = 12
LYING = 0.35  # [m]


CAUSES = dict(
    zip(
        KINDS,
        (
            "weak_motor",
            "low_gain",
            "command_jump",
            "slip",
            "push",
            "starts_high",
            "load",
            "late_commands",
        ),
    )
)
"""Names of the first causes that are right."""


def causes(bench):
    """First causes of 80 simulated faults of 8 kinds in MuJoCo, and of 20 sound runs.

    A fault counts if the robot falls, a joint is 0.2 rad off its command, or the base
    0.3 rad, and not without the fault. The joint must be right, too.
    """
    checker, kept = bench.robot.checker(), None
    for number, kind in enumerate((*KINDS, "sound")):
        with bench.attempt(kind):
            count = bench.length(20 if kind == "sound" else 10, 1)
            right, made = 0, 0
            for one in range(count):
                seeds = ([number, one, each] for each in range(TRIES))
                draws = map(np.random.default_rng, seeds)
                tried = (run(bench.robot, kind, random) for random in draws)
                found = next((each for each in tried if each), None)
                if found is None:
                    continue
                made += 1
                kept = kept or found
                right += is_right(checker.explain(*found[:2]), found[2])
            bench.add(f"{kind}: right", right, f"of {made}", f">= {0.8 * made:g}")
    with bench.attempt("time"):
        states = repeated(kept[0], 60.0)
        begin = time.process_time()
        checker.explain(states, kept[1])
        seconds = time.process_time() - begin
        bench.add("a minute of history", seconds, "s", "<= 2")


def is_right(found, fault):
    """Whether an explanation names the fault; of a sound run, whether there is none."""
    if fault.kind == "sound":
        return found is None
    first = found.chain[0] if found and found.chain else None
    is_named = first is not None and first.name == CAUSES[fault.kind]
    has_joint = fault.kind in ("weak motor", "wrong gain", "jump")
    return is_named and (not has_joint or first.subject == (fault.joint,))


def repeated(states, seconds):
    """Put states behind each other until they last for a time in [s]."""
    span = int(states.stamps[-1])
    count = int(np.ceil(1e9 * seconds / span))
    shifts = span * np.arange(count)[:, np.newaxis]
    rows = np.tile(np.arange(len(states.stamps)), count)
    stamps = (states.stamps + shifts).ravel()
    return replace(states.rows(rows), stamps=stamps)


class Fault:
    """What is wrong in a run."""

    def __init__(self, kind, robot, random):
        self.kind, self.robot = kind, robot
        self.joint = self.mass = self.lift = self.push = self.motor = None
        self.friction = None
        side = random.choice(SIDES)
        at = random.uniform(1.2, 2.5)
        if kind == "weak motor":
            name, limit = WEAK[random.integers(len(WEAK))]
            self.joint = name.format(side)
            self.motor = ServoMotor(random.uniform(0.3, 1.0) * limit)
        if kind == "wrong gain":
            self.joint = WEAK[random.integers(len(WEAK))][0].format(side)
            self.motor = PdMotor(stiffness=random.uniform(1.0, 20.0), damping=1.0)
        if kind in ("jump", "late stream"):
            self.span = (
                at,
                at + random.uniform(*((0.2, 0.2), (0.3, 0.8))[kind != "jump"]),
            )
            name = random.choice(["knee", "hip_pitch", "ankle_pitch", "hip_roll"])
            self.joint = f"{side}_{name}_joint"
            self.jump = random.uniform(0.4, 0.9) * random.choice([-1.0, 1.0])
        if kind == "slippery floor":
            self.friction = random.uniform(0.01, 0.06)
        if kind == "push":
            angle = random.uniform(0.0, 2.0 * np.pi)
            size = random.uniform(100.0, 350.0)
            self.push = at, 0.2, size * np.cos(angle), size * np.sin(angle)
        if kind == "base too high":
            self.lift = random.uniform(0.1, 0.4)
        if kind == "heavy hand":
            self.mass = f"{side}_wrist_yaw_link", random.uniform(4.0, 12.0)


def positions(robot, times, random, kind):
    """Draw a motion of all joints, shape (n, n_joints)."""
    is_slow = kind in ("weak motor", "wrong gain") or random.uniform() < 0.3
    if is_slow and kind != "slippery floor":
        stepping = robot.read_motion("step_in_place.csv")
        return robot.positions_of(stepping.resampled(50.0))[: len(times)]
    found = np.tile(robot.named_configuration("stand"), (len(times), 1))
    rate, depth = random.uniform(0.3, 0.6), random.uniform(0.05, 0.15)
    bend = random.uniform(0.1, 0.3) + depth * (1 - np.cos(2 * np.pi * rate * times))
    begin = np.clip(times, 0.0, 1.0)
    swing = (
        begin
        * random.uniform(0.1, 0.3)
        * np.sin(2 * np.pi * random.uniform(0.5, 1) * times)
    )
    if kind == "slippery floor":
        rate, size = random.uniform(0.8, 1.3), begin * random.uniform(0.5, 0.9)
        turn = size * np.sin(2 * np.pi * rate * times)
        found[:, robot.joint_row("waist_yaw_joint")] += turn
    for side in SIDES:
        for joint, share in LEGS.items():
            found[:, robot.joint_row(f"{side}_{joint}_joint")] = share * bend
        found[:, robot.joint_row(f"{side}_shoulder_pitch_joint")] += swing
    return found


def drawn(robot, kind, random):
    """Draw a fault, its motion, that without the fault, and the stream of commands."""
    fault = Fault(kind, robot, random)
    times, names = np.arange(0.0, LENGTH, PERIOD), tuple(robot.joint_names)
    sound = positions(robot, times, random, kind)
    wanted, kept = sound.copy(), np.ones(len(times), dtype=bool)
    if kind == "jump":
        inside = (times >= fault.span[0]) & (times < fault.span[1])
        wanted[inside, robot.joint_row(fault.joint)] += fault.jump
    if kind == "late stream":
        kept = (times < fault.span[0]) | (times >= fault.span[1])
        wanted[~kept] = wanted[kept][times[kept] < fault.span[0]][-1]
    command = Command(SENDER, "joint_commands", "29 joints", names)
    stamps = np.round(1e9 * times[kept]).astype(np.int64)
    ends = int(stamps[0]), int(stamps[-1])
    stream = CommandStream(*ends, len(stamps), command, stamps, wanted[kept])
    return fault, Motion(times, names, wanted), Motion(times, names, sound), stream


def run(robot, kind, random):
    """Simulate a run; None if it failed without a fault, or not with it."""
    fault, motion, sound, stream = drawn(robot, kind, random)
    made = simulated(robot, motion, fault)
    if kind == "sound":
        return None if has_failed(made) else (made, [stream], fault)
    if not has_failed(made) and kind != "slippery floor":
        return None
    usual = simulated(robot, sound, Fault("", robot, random))
    if has_failed(usual):
        return None
    if kind == "slippery floor":
        rows = slice(len(made.stamps))
        made = replace(made, commanded_bases=usual.base_poses[rows])
    return (made, [stream], fault) if has_failed(made) else None


def simulated(robot, motion, fault):
    """Simulate a motion with a fault; return its states."""
    lumped = lump_fixed_joints(robot.description)
    start = dict(zip(motion.joint_names, motion.positions[0].tolist()))
    assembly = replace(lumped, positions=start)
    pose = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0])
    pose[2] = standing_height(assembly, pose[3:]) + (fault.lift or 0.0)
    links = assembly.description.links
    if fault.mass:
        links = [with_mass(link, *fault.mass) for link in links]
    if fault.friction is not None:
        links = [slippery(link, fault.friction) for link in links]
    assembly = replace(
        assembly, description=replace(assembly.description, links=tuple(links))
    )
    motors = motors_of(robot.description)
    if fault.motor:
        own = Motors({fault.joint: fault.motor})
        own._motors += motors._motors
        motors = own
    rows = []
    with closing(World("hold", PhysicsProperties(), None, motors, "mujoco")) as world:
        world.spawn("g1", assembly, pose)
        model = world.model("g1")
        order = [list(model.joint_names).index(name) for name in motion.joint_names]
        world.motions.play(model, motion, world.time_ns)
        if fault.push:
            at, length, x, y = fault.push
            begin = round(1e9 * at)
            link = next(link for link in model.link_names if "torso" in link)
            world.forces.apply_wrench(
                world.entities.link(f"g1::{link}"),
                Span(begin, begin + round(1e9 * length)),
                np.array([x, y, 0.0, 0.0, 0.0, 0.0]),
                world.time_ns,
            )
        for number in range(round(LENGTH / STEP)):
            world.advance(1)
            if number % ROW == ROW - 1:
                own = model.position[order], model.velocity[order]
                efforts = world.engine.efforts(model)[order]
                rows.append(np.concatenate([*own, efforts, model.root_poses[0]]))
                if model.root_poses[0, 2] < LYING:
                    break
    rows = np.array(rows)
    n = len(motion.joint_names)
    stamps = 1_000_000 * ROW * np.arange(1, len(rows) + 1)
    commanded = sample(motion, 1e-9 * stamps).positions
    return Stretch(
        1,
        stamps,
        motion.joint_names,
        motion.joint_names,
        rows[:, :n],
        rows[:, n : 2 * n],
        rows[:, 3 * n :],
        None,
        rows[:, 2 * n : 3 * n],
        commanded,
    )


def with_mass(link, name, mass):
    """Add a mass to a link."""
    if link.name != name:
        return link
    return replace(
        link, inertial=replace(link.inertial, mass=link.inertial.mass + mass)
    )


def slippery(link, friction):
    """Give shapes of a link another coefficient of friction."""
    shapes = tuple(replace(shape, friction=friction) for shape in link.collisions)
    return replace(link, collisions=shapes)


def has_failed(stretch):
    """Whether the robot fell, or a joint was far from its command."""
    up = 1.0 - 2.0 * (stretch.base_poses[:, 3:5] ** 2).sum(axis=1)
    drop = stretch.base_poses[0, 2] - stretch.base_poses[:, 2]
    error = np.abs(stretch.positions - stretch.commanded)[20:]
    fell = (up < np.cos(np.pi / 4)) | (drop > 0.45)
    turned = False
    if stretch.commanded_bases is not None:
        cosine = np.abs(
            (stretch.base_poses * stretch.commanded_bases)[:, 3:].sum(axis=1)
        )
        turned = bool((cosine < np.cos(TURNED / 2.0)).any())
    return turned or bool(fell.any()) or float(error.max()) > ERROR
