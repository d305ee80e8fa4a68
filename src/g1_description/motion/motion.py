"""A motion read from a file, and fitting it to a robot."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from g1_description.errors import MotionError
from g1_description.motion.trajectory import Trajectory
from g1_description.robot.description import Description
from g1_description.text import listed


@dataclass(frozen=True)
class Motion:
    """A motion that fits a robot."""

    trajectory: Trajectory

    notes: tuple[str, ...] = ()
    """Messages on assumptions, and on joints that do not fit."""

    has_times: bool = True
    """Whether the file has times or a rate."""


def fitted(motion: Motion, robot: Description) -> Motion:
    """Remove the joints that a robot does not have.

    Returns:
        The motion of the other joints, in their order, with notes.

    Raises:
        MotionError: If the robot has none of its joints.
    """
    own = [joint.name for joint in robot.movable_joints]
    names = motion.trajectory.joint_names
    if not names and motion.trajectory.base_poses is None:
        raise MotionError("The motion has neither joints nor a base.")
    unknown = [name for name in names if name not in own]
    if names and len(unknown) == len(names):
        raise MotionError(
            f"{robot.name} has none of the motion's joints, {listed(names)}. Its "
            f"joints: {listed(own)}."
        )
    notes = [*motion.notes]
    if unknown:
        notes.append(
            f"Joints that {robot.name} does not have are ignored: {listed(unknown)}."
        )
    missing = [name for name in own if name not in names]
    if missing:
        notes.append(
            f"Joints missing from the motion are not moved: {listed(missing)}."
        )
    trajectory = _without(motion.trajectory, unknown)
    return replace(motion, trajectory=trajectory, notes=tuple(notes))


def _without(trajectory: Trajectory, unknown: Sequence[str]) -> Trajectory:
    """Remove some joints."""
    if not unknown:
        return trajectory
    names = trajectory.joint_names
    kept = [number for number, name in enumerate(names) if name not in unknown]
    velocities = trajectory.velocities
    return replace(
        trajectory,
        joint_names=tuple(names[number] for number in kept),
        positions=trajectory.positions[:, kept],
        velocities=None if velocities is None else velocities[:, kept],
    )
