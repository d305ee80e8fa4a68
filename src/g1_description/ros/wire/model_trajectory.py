"""Motions as messages for the stand-in."""

from __future__ import annotations

from g1_description.core.motion.trajectory import Trajectory
from g1_description.msg import ModelTrajectory

from .conversions import stamp_from_ns


def model_trajectory(
    model: str, trajectory: Trajectory, start_ns: int | None = None
) -> ModelTrajectory:
    """Write a motion as a message.

    Args:
        model: Name of the model in the simulator.
        trajectory: The motion.
        start_ns: When its times count from, in [ns]; None: from the next step on.
    """
    velocities, bases = trajectory.velocities, trajectory.base_poses
    return ModelTrajectory(
        model,
        stamp_from_ns(start_ns or 0),
        list(trajectory.joint_names),
        trajectory.times.tolist(),
        trajectory.positions.ravel().tolist(),
        [] if velocities is None else velocities.ravel().tolist(),
        [] if bases is None else bases.ravel().tolist(),
    )
