"""A motion as it comes from a file, and how it fits a robot."""

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
    """Messages on what was assumed, and what does not fit."""

    has_times: bool = True
    """Whether the file says when its samples are, or at what rate."""


def fitted(motion: Motion, robot: Description) -> Motion:
    """Leave out the joints that a robot does not have.

    Returns:
        The motion of the others, in its own order, with notes.

    Raises:
        MotionError: If it has none of them.
    """
    own = [joint.name for joint in robot.movable_joints]
    names = motion.trajectory.joint_names
    if not names and motion.trajectory.base_poses is None:
        raise MotionError("The motion has neither joints nor a base.")
    unknown = [name for name in names if name not in own]
    if names and len(unknown) == len(names):
        raise MotionError(
            f"{robot.name} has none of the motion's joints, {listed(names)}; it has "
            f"{listed(own)}."
        )
    notes = [*motion.notes]
    if unknown:
        notes.append(f"{robot.name} has no {listed(unknown)}: left out.")
    missing = [name for name in own if name not in names]
    if missing:
        notes.append(f"The motion has no {listed(missing)}: not moved.")
    trajectory = _without(motion.trajectory, unknown)
    return replace(motion, trajectory=trajectory, notes=tuple(notes))


def _without(trajectory: Trajectory, unknown: Sequence[str]) -> Trajectory:
    """Leave out some joints."""
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
