"""A motion played in ``hold`` physics from beginning to end, and what happened.

Nothing here knows ROS or a clock: steps follow each other as fast as they are computed.
The steps, the floor, the motors and the report are those of the stand-in, in a world
that nothing else uses, so that the same motion gives the same bits each time.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from contextlib import closing
from dataclasses import dataclass, field

import numpy as np

from g1_description.errors import InvalidValueError
from g1_description.motion.motors import Motors
from g1_description.motion.tracking import FallLimits, TrackingReport
from g1_description.motion.trajectory import Trajectory, sample
from g1_description.robot.description import Description
from g1_description.robot.lumping import lump_fixed_joints
from g1_description.sim.model import Model
from g1_description.sim.motions import WATCH_TIME, MotionTracker
from g1_description.sim.physics import PhysicsProperties
from g1_description.sim.standing import at_beginning, complete, place
from g1_description.sim.world import World

MAX_ROWS = 30_000
"""Most rows that are recorded, 30 MB of the G1: of a longer motion fewer per second."""


@dataclass(frozen=True)
class Conditions:
    """What a motion is played under, by default what the stand-in has."""

    motors: Motors | None = None
    """What drives the joints; None: motors as strong as the robot's file says. The
    stand-in has those of ``config/motors.yaml`` for the G1."""

    properties: PhysicsProperties = field(default_factory=PhysicsProperties)
    fall_limits: FallLimits = field(default_factory=FallLimits)
    fixed_base: bool = False
    """Whether the base hangs clear of the floor and does not move."""

    on_floor: bool = True
    """Whether the motion is lifted or lowered by one constant, so that the robot begins
    on the floor. A motion without a base always begins there."""

    stops_at_fall: bool = False
    """Whether it ends with a fall: what a robot does on the floor says nothing of the
    motion."""

    rate: float = 200.0
    """Rows that are recorded per second of simulated time, at most, in [Hz]."""

    def __post_init__(self) -> None:
        """Check the numbers.

        Raises:
            InvalidValueError: If one is out of its range.
        """
        if not 0.0 < self.rate < math.inf:
            raise InvalidValueError(f"rate is {self.rate}, it must be above 0 Hz")
        if not self.properties.step_ns:
            raise InvalidValueError("time_step is 0, no motion goes on then")


@dataclass(frozen=True, eq=False)
class Rollout:
    """What happened when motors followed a motion.

    Each row of an array is the state after a step, and what the motors did in it. The
    last rows are those after the motion, in which the robot only has to stay upright.
    """

    report: TrackingReport
    """Errors, efforts at their limits and the fall, from every step of the motion."""

    joint_names: tuple[str, ...]
    """All movable joints of the robot; those that the motion does not have are held
    where they begin."""

    effort_limits: np.ndarray
    """What the motors can give at most, in [N m] or [N], shape (n_joints,); infinite
    where no limit is known."""

    times: np.ndarray
    """Times of the motion in [s], shape (n,)."""

    wanted: np.ndarray
    """What the motors were to reach, in [rad] or [m], shape (n, n_joints): the motion
    inside the limits."""

    positions: np.ndarray
    """In [rad] or [m], shape (n, n_joints)."""

    velocities: np.ndarray
    """In [rad/s] or [m/s], shape (n, n_joints)."""

    efforts: np.ndarray
    """What the motors applied, in [N m] or [N], shape (n, n_joints)."""

    base_poses: np.ndarray
    """T_world_base of the root link, shape (n, 7)."""

    wanted_base_poses: np.ndarray | None
    """The motion's, lifted by ``lift``, shape (n, 7); None where it has no base."""

    lift: float
    """By how much the motion was lifted to begin on the floor, or clear of it, in [m];
    0 where it has no base."""

    left_out: tuple[str, ...]
    """A message for each thing of the robot that is not simulated as it is."""

    @property
    def fell_at(self) -> float | None:
        """When the robot fell, a time of the motion in [s]; None if it did not."""
        return self.report.fall_time


def rollout(
    robot: Description,
    motion: Trajectory,
    conditions: Conditions | None = None,
    on_progress: Callable[[float], None] | None = None,
) -> Rollout:
    """Let a robot follow a motion by its motors, and watch it until a second later.

    It begins at rest at the motion's first sample; without a base in the motion, it
    begins upright on the floor.

    Args:
        robot: The robot, as in its file.
        motion: The motion; joints that the robot does not have are ignored.
        conditions: What it is played under; by default the stand-in's.
        on_progress: Called for each row with the share that is done, from 0 to 1.

    Raises:
        InvalidValueError: If the robot cannot do any of the motion, or the motion
            begins before 0 s.
        DescriptionError: If the robot cannot be simulated.
    """
    if motion.times[0] < 0.0:
        raise InvalidValueError(
            f"The motion begins at {motion.times[0]:.6g} s; motors follow a motion "
            "from 0 s on."
        )
    under = conditions or Conditions()
    assembly = at_beginning(lump_fixed_joints(robot), motion)
    pose, lift = place(assembly, motion, under.on_floor, under.fixed_base)
    with closing(World("hold", under.properties, motors=under.motors)) as world:
        world.motions.fall_limits = under.fall_limits
        left_out = world.spawn(robot.name, assembly, pose, under.fixed_base)
        player = _Player(world, world.model(robot.name), motion, under)
        report = player.run(under.stops_at_fall, on_progress)
        return player.rollout(report, lift, left_out)


class _Player:
    """Lets a model go through a motion, and records rows of its state."""

    def __init__(
        self, world: World, model: Model, motion: Trajectory, conditions: Conditions
    ) -> None:
        self._world, self._model = world, model
        self._motion = complete(model, motion)
        self._start_ns = world.time_ns - round(1e9 * float(self._motion.times[0]))
        world.motions.play(model, self._motion, self._start_ns)
        step_ns = conditions.properties.step_ns
        end_ns = self._start_ns + round(1e9 * self._motion.duration)
        motion_steps = -((world.time_ns - end_ns) // step_ns)
        self._n_steps = max(motion_steps, 1) + -(-WATCH_TIME // step_ns)
        stride = round(1e9 / (conditions.rate * step_ns))
        stride = max(stride, 1, -(-self._n_steps // MAX_ROWS))
        self._stride = min(stride, self._n_steps)
        n_numbers = 1 + 4 * len(model.joint_names) + 7
        self._rows = np.zeros((self._n_steps // self._stride + 1, n_numbers))
        self._n_rows = 0

    def run(
        self, stops_at_fall: bool, on_progress: Callable[[float], None] | None
    ) -> TrackingReport:
        """Go through the motion; return how well the motors followed."""
        tracker = self._step()
        for number in range(1, self._n_steps + 1):
            is_over = stops_at_fall and tracker.has_fallen
            if is_over or number % self._stride == 0:
                self._record()
                if on_progress:
                    on_progress(number / self._n_steps)
            if is_over or number == self._n_steps:
                break
            self._world.step()
        return tracker.tracked().report

    def _step(self) -> MotionTracker:
        """Compute the first step; return what watches the motion from then on."""
        self._world.step()
        tracker = self._world.motions.tracker(self._model)
        assert tracker is not None, "a motion in hold is watched"
        return tracker

    def _record(self) -> None:
        """Add a row: time, targets, positions, velocities, efforts, base."""
        model = self._model
        self._rows[self._n_rows] = np.concatenate(
            [
                [1e-9 * (self._world.time_ns - self._start_ns)],
                model.target,
                model.position,
                model.velocity,
                self._world.motions.efforts(model),
                model.root_poses[0],
            ]
        )
        self._n_rows += 1

    def rollout(
        self, report: TrackingReport, lift: float, left_out: tuple[str, ...]
    ) -> Rollout:
        """Return what happened.

        Args:
            report: How well the motors followed.
            lift: By how much the motion was lifted, in [m].
            left_out: What of the robot is not simulated as it is.
        """
        model, rows = self._model, self._rows[: self._n_rows]
        widths = [1, *4 * [len(model.joint_names)], 7]
        columns = np.split(rows, np.cumsum(widths)[:-1], axis=1)
        times, wanted, positions, velocities, efforts, bases = map(np.array, columns)
        wanted_bases = sample(self._motion, times[:, 0]).base_poses
        if wanted_bases is not None:
            wanted_bases = wanted_bases + lift * np.eye(7)[2]
        return Rollout(
            report=report,
            joint_names=model.joint_names,
            effort_limits=self._world.motions.effort_limits(model),
            times=times[:, 0],
            wanted=wanted,
            positions=positions,
            velocities=velocities,
            efforts=efforts,
            base_poses=bases,
            wanted_base_poses=wanted_bases,
            lift=lift,
            left_out=left_out,
        )
