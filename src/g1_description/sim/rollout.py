"""A motion played in ``hold`` physics from start to end, and its outcome.

It runs without ROS and as fast as possible, with the steps, floor, motors and report of
the simulator, in a world of its own: the result is deterministic.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass, field, replace

import numpy as np

from g1_description.errors import InvalidValueError
from g1_description.motion.motion import SINGLE_TIME, Motion, sample
from g1_description.motion.motors import Motors, motors_of
from g1_description.motion.tracking import FallLimits, TrackingReport
from g1_description.robot.assembly import Assembly
from g1_description.robot.description import Description
from g1_description.robot.lumping import lump_fixed_joints
from g1_description.robot.transform import IDENTITY, compose, inverse
from g1_description.sim.engine import MAX_STEPS, PhysicsProperties, Steps
from g1_description.sim.engines import engine_class
from g1_description.sim.model import Model
from g1_description.sim.motions import LIMIT_TOLERANCE, WATCH_TIME, MotionTracker
from g1_description.sim.standing import hanging_height, standing_height
from g1_description.sim.world import World

MAX_ROWS = 30_000
"""Maximum number of recorded rows, 30 MB for the G1; it bounds the rate."""


@dataclass(frozen=True)
class Conditions:
    """The conditions of a rollout, by default the simulator's."""

    motors: Motors | str | None = None
    """Motors of the joints, or a name of those of the robot's profile; None: the usual
    ones."""

    properties: PhysicsProperties = field(default_factory=PhysicsProperties)
    engine: str = "bullet"
    """One of ``ENGINES``."""

    fall_limits: FallLimits = field(default_factory=FallLimits)
    fixed_base: bool = False
    """Whether the base hangs clear of the floor and does not move."""

    on_floor: bool = True
    """Whether the motion is shifted vertically by a constant, so that the robot starts
    on the floor. A motion without a base always starts there."""

    has_limits: bool = True
    """Whether motors have limits of effort."""

    objects: tuple[tuple[str, Assembly, np.ndarray], ...] = field(
        default=(), compare=False
    )
    """Names of other models, their links, and their poses in the world."""

    holds: tuple[tuple[float, str, str], ...] = field(default=(), compare=False)
    """Times in [s], increasing, names of objects, and links of the robot that carry
    them from then on; empty: none does."""

    rate: float = 200.0
    """Largest number of recorded rows per second of simulated time, in [Hz]."""

    def __post_init__(self) -> None:
        """Check the numbers.

        Raises:
            InvalidValueError: If one is out of its range.
            UnknownNameError: If the engine is not installed.
        """
        if not 0.0 < self.rate < math.inf:
            raise InvalidValueError(f"rate must be greater than 0 Hz (got {self.rate})")
        if not self.properties.step_ns:
            raise InvalidValueError("time_step must be greater than 0")
        engine_class(self.engine)


@dataclass(frozen=True, eq=False)
class Rollout:
    """The outcome of a motion that motors followed.

    Each row of an array is the state after a step, and the efforts in it. The last rows
    are after the motion.
    """

    report: TrackingReport
    """Errors, efforts at their limits and the fall, from every step of the motion."""

    joint_names: tuple[str, ...]
    """All movable joints of the robot; those not in the motion keep their positions."""

    effort_limits: np.ndarray
    """Effort limits of the motors, in [N m] or [N], shape (n_joints,); infinite if
    unknown."""

    times: np.ndarray
    """Times of the motion in [s], shape (n,)."""

    desired: np.ndarray
    """Targets of the motors, clamped to the limits, in [rad] or [m], shape
    (n, n_joints)."""

    positions: np.ndarray
    """In [rad] or [m], shape (n, n_joints)."""

    velocities: np.ndarray
    """In [rad/s] or [m/s], shape (n, n_joints)."""

    efforts: np.ndarray
    """Efforts of the motors, in [N m] or [N], shape (n, n_joints)."""

    mean_efforts: np.ndarray
    """Means of these over all steps since the row before, shape (n, n_joints)."""

    base_poses: np.ndarray
    """T_world_base of the root link, shape (n, 7)."""

    desired_base_poses: np.ndarray | None
    """Base poses of the motion, shifted by ``lift``, shape (n, 7); None without a base.
    """

    lift: float
    """Vertical shift of the motion to start on the floor, or clear of it, in [m]; 0
    without a base."""

    object_poses: Mapping[str, np.ndarray]
    """T_world_object of other models at the end by name, shape (7,)."""

    left_out: tuple[str, ...]
    """A message for each part of the robot that is not simulated."""

    engine: str
    """One of ``ENGINES``."""

    @property
    def fell_at(self) -> float | None:
        """Time of the motion at which the robot fell, in [s]; None if it did not."""
        return self.report.fall_time


def rollout(
    robot: Description,
    motion: Motion,
    conditions: Conditions | None = None,
    on_progress: Callable[[float], None] | None = None,
) -> Rollout:
    """Simulate a robot whose motors follow a motion, until a second after its end.

    A fall ends it: a robot on the floor follows no motion. It starts at rest at the
    motion's first sample; without a base in the motion, upright on the floor.

    Args:
        robot: The robot.
        motion: The motion; unknown joints are ignored.
        conditions: By default those of the simulator.
        on_progress: Called for each row with the progress, from 0 to 1.

    Raises:
        InvalidValueError: If the motion has no joint of the robot, or starts before
            0 s.
        DescriptionError: If the robot cannot be simulated.
    """
    if motion.times[0] < 0.0:
        raise InvalidValueError(
            f"The motion must not start before 0 s (got {motion.times[0]:.6g} s)."
        )
    under = conditions or Conditions()
    motors = under.motors
    if not under.has_limits:
        robot, motors = _unlimited(robot, motors)
    assembly = _at_beginning(lump_fixed_joints(robot), motion)
    pose, lift = _place(assembly, motion, under.on_floor, under.fixed_base)
    world = World("hold", under.properties, None, motors, under.engine)
    with closing(world):
        world.motions.fall_limits = under.fall_limits
        left_out = world.spawn(robot.name, assembly, pose, under.fixed_base)
        for name, other, place in under.objects:
            left_out += world.spawn(name, other, place)
        model = world.model(robot.name)
        played = _complete(model, motion)
        begin, step = float(played.times[0]), world.properties.time_step
        start_ns = world.time_ns - round(1e9 * begin)
        world.motions.play(model, played, start_ns)
        counts = _steps(start_ns + round(1e9 * played.end) - world.time_ns, under)
        given = begin, counts, under.holds, on_progress
        tracker, rows = _stepped(world, model, *given)
        widths = [1, *4 * [len(model.joint_names)], 7]
        columns = np.split(rows, np.cumsum(widths)[:-1], axis=1)
        numbers, positions, velocities, efforts, mean_efforts, bases = columns
        times = begin + step * numbers[:, 0]
        at_times = sample(played, times)
        desired = np.minimum(
            np.maximum(at_times.positions, model.lower - LIMIT_TOLERANCE),
            model.upper + LIMIT_TOLERANCE,
        )
        desired_bases = at_times.base_poses
        if desired_bases is not None:
            desired_bases = desired_bases + lift * np.eye(7)[2]
        return Rollout(
            report=tracker.report,
            joint_names=model.joint_names,
            effort_limits=world.engine.effort_limits(model),
            times=times,
            desired=desired,
            positions=positions,
            velocities=velocities,
            efforts=efforts,
            mean_efforts=mean_efforts,
            base_poses=bases,
            desired_base_poses=desired_bases,
            lift=lift,
            object_poses={
                name: world.model(name).root_poses[0].copy()
                for name, *_ in under.objects
            },
            left_out=left_out,
            engine=under.engine,
        )


def _stepped(
    world: World,
    model: Model,
    begin: float,
    counts: tuple[int, int],
    holds: Sequence[tuple[float, str, str]],
    on_progress: Callable[[float], None] | None,
) -> tuple[MotionTracker, np.ndarray]:
    """Compute the steps of a motion that is played; a fall ends it.

    Args:
        world: The world.
        model: The robot.
        begin: First time of the motion, in [s].
        counts: Numbers of steps, and of steps per row.
        holds: As in ``Conditions``.
        on_progress: As for ``rollout``.

    Returns:
        The robot's tracker, and rows as from ``_rows``.
    """
    (n_steps, stride), step = counts, world.properties.time_step
    together = stride * max(1, MAX_STEPS // stride)
    due = [math.ceil(max((one[0] - begin) / step - 1e-6, 0.0)) for one in holds]
    rows: list[np.ndarray] = []
    tracker: MotionTracker | None = None
    since: list[Steps] = []
    number = held = 0
    while number < n_steps and not (tracker and tracker.has_fallen):
        while held < len(due) and due[held] <= number:
            _hold(world, model, *holds[held][1:])
            held += 1
        most = min(together - number % together, n_steps - number)
        count = world.advance(min([most, *(one - number for one in due[held:])]))
        number += count
        tracker = tracker or world.motions.tracker(model)
        assert tracker is not None, "a motion in hold is tracked"
        since.append(world.engine.last_steps(model, count))
        if not number % together or number == n_steps or tracker.has_fallen:
            fall = tracker.report.fall_time
            end = n_steps if fall is None else round((fall - begin) / step)
            rows.append(_rows(since, stride, number, end))
            since = []
            if on_progress:
                on_progress(number / n_steps)
    assert tracker is not None  # there is at least one step
    return tracker, np.concatenate(rows)


def _hold(world: World, robot: Model, name: str, link: str) -> None:
    """Let a link of a robot carry an object, or let the object go."""
    if link:
        world.attachments.attach(world.model(name), "", robot, link)
    else:
        world.attachments.detach(world.model(name))


def _rows(parts: Sequence[Steps], stride: int, last: int, end: int) -> np.ndarray:
    """Take every n-th step, and the last one.

    Args:
        parts: The steps.
        stride: Number of steps per row.
        last: Number of the last step.
        end: Number of the last one to take.

    Returns:
        Numbers of the steps, positions, velocities, efforts, their means since the
        row before, and base poses, shape (n, n_columns).
    """
    steps = Steps(*map(np.concatenate, zip(*parts)))
    first = last - len(steps.positions)
    count = min(last, end) - first
    begins = np.arange(0, count, stride)
    ends = np.append(begins[1:], count)
    means = (
        np.add.reduceat(steps.efforts[:count], begins) / (ends - begins)[:, np.newaxis]
    )
    positions, velocities, efforts, bases = (part[ends - 1] for part in steps)
    numbers = (first + ends)[:, np.newaxis]
    return np.hstack([numbers, positions, velocities, efforts, means, bases])


def _unlimited(
    robot: Description, motors: Motors | str | None
) -> tuple[Description, Motors]:
    """Remove the limits of effort from a robot and its motors."""
    if not isinstance(motors, Motors):
        motors = motors_of(robot, motors or "")
    joints = tuple(replace(joint, effort=math.inf) for joint in robot.joints)
    return replace(robot, joints=joints), motors.unlimited()


def _steps(duration_ns: int, conditions: Conditions) -> tuple[int, int]:
    """Return the number of steps, and of steps per row."""
    step_ns = conditions.properties.step_ns
    n_steps = max(-(-duration_ns // step_ns), 1) - (-WATCH_TIME // step_ns)
    stride = max(round(1e9 / (conditions.rate * step_ns)), 1, -(-n_steps // MAX_ROWS))
    return n_steps, min(stride, n_steps)


def _at_beginning(assembly: Assembly, motion: Motion) -> Assembly:
    """Set joints to the start of a motion, others to zero, clamped to their limits.

    Raises:
        InvalidValueError: If the robot has none of the motion's joints.
    """
    first = dict(zip(motion.joint_names, motion.positions[0].tolist()))
    joints = assembly.description.movable_joints
    if not any(joint.name in first for joint in joints):
        name = assembly.description.name
        raise InvalidValueError(f"the motion has no joint of {name}")
    begin = {
        joint.name: float(np.clip(first.get(joint.name, 0.0), joint.lower, joint.upper))
        for joint in joints
    }
    return replace(assembly, positions=begin)


def _place(
    assembly: Assembly, motion: Motion, on_floor: bool, hangs: bool
) -> tuple[np.ndarray, float]:
    """Place a robot at the start of a motion; without a base, upright on the floor.

    Returns:
        Pose of the model frame in the world, shape (7,), and its height above that of
        the motion, in [m]; 0 without a base.
    """
    pose = np.array(IDENTITY)
    if motion.base_poses is not None:
        pose = compose(motion.base_poses[0], inverse(assembly.root_pose))
    height = float(pose[2])
    if hangs:
        pose[2] = hanging_height(assembly, pose[3:])
    elif on_floor or motion.base_poses is None:
        pose[2] = standing_height(assembly, pose[3:])
    return pose, 0.0 if motion.base_poses is None else float(pose[2]) - height


def _complete(model: Model, motion: Motion) -> Motion:
    """Extend a motion to all joints of a robot and at least two samples.

    Other joints keep their positions. A single configuration is repeated, as it would
    not be tracked.
    """
    times, bases = motion.times, motion.base_poses
    columns = {name: column for column, name in enumerate(motion.joint_names)}
    known = [row for row, name in enumerate(model.joint_names) if name in columns]
    own = [columns[model.joint_names[row]] for row in known]
    positions = np.tile(model.position, (len(times), 1))
    positions[:, known] = motion.positions[:, own]
    velocities = None
    if len(times) == 1:
        times = times[0] + np.array([0.0, SINGLE_TIME])
        positions = np.repeat(positions, 2, axis=0)
        bases = None if bases is None else np.repeat(bases, 2, axis=0)
    elif motion.velocities is not None:
        velocities = np.zeros_like(positions)
        velocities[:, known] = motion.velocities[:, own]
    return Motion(times, model.joint_names, positions, velocities, bases)
