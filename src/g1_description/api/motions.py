"""A robot's motions: from files, to files, from arrays."""

from __future__ import annotations

from os import PathLike
from pathlib import Path
from typing import Any

import numpy as np

from g1_description.core.errors import MotionError
from g1_description.core.motion.formats.read import read_motion
from g1_description.core.motion.formats.write import write_motion
from g1_description.core.motion.motion import Motion
from g1_description.core.motion.trajectory import Trajectory

from .joint_values import JointValues
from .model import RobotModel
from .poses import as_poses


class RobotMotions(RobotModel):
    """A robot that goes through motions."""

    def read_motion(
        self, path: str | PathLike[str], rate: float | None = None
    ) -> Motion:
        """Read a motion from a file.

        Args:
            path: CSV, npz, pickle, or YAML of a JointTrajectory.
            rate: Samples per second of a file without times.

        Returns:
            The motion with the joints that the robot has, in the order of the file;
            ``notes`` say what was assumed and what does not fit.

        Raises:
            MotionError: If there is no such file, or no motion in it that fits.
        """
        if rate is not None and not (
            isinstance(rate, (int, float, np.number)) and 0.0 < rate < np.inf
        ):
            raise MotionError(f"The rate is {rate!r}; it must be a number above 0.")
        return read_motion(Path(path).expanduser(), self.description, rate)

    def write_motion(
        self,
        path: str | PathLike[str],
        trajectory: Trajectory,
        rate: float | None = None,
    ) -> tuple[str, ...]:
        """Write a motion to a file.

        Args:
            path: Ending in .csv or .npz; a file that is there is replaced.
            trajectory: The motion.
            rate: Samples per second of an npz; by default those of the motion.

        Returns:
            Messages on what is not as in the motion.

        Raises:
            MotionError: If the format cannot hold it.
            InvalidValueError: If the file cannot be written.
        """
        return write_motion(Path(path).expanduser(), trajectory, self.description, rate)

    def trajectory(
        self,
        times: Any,
        positions: JointValues,
        velocities: JointValues | None = None,
        base_poses: Any = None,
    ) -> Trajectory:
        """Make a motion of all joints.

        Args:
            times: In [s], rising, shape (n_samples,).
            positions: Of the joints, shape (n_samples, n_joints).
            velocities: Likewise; by default unknown: joints move in straight lines.
            base_poses: Of the base link, shape (n_samples, 7); by default the base does
                not belong to the motion.

        Raises:
            G1DescriptionError: If that is no motion of this robot.
        """
        placed = self.positions(positions)
        rates = (
            None
            if velocities is None
            else self._rates(velocities, placed.shape, "velocity")
        )
        poses = None if base_poses is None else as_poses(base_poses)
        own_times = np.array(times, dtype=float)
        return Trajectory(own_times, self.joint_names, placed, rates, poses)

    def positions_of(self, trajectory: Trajectory) -> np.ndarray:
        """Arrange the positions of a motion in the order of the robot's joints.

        Returns:
            Positions, shape (n_samples, n_joints); joints that it does not move are
            neutral.

        Raises:
            UnknownNameError: If it moves joints that the robot does not have.
        """
        if not trajectory.joint_names:
            return np.tile(self.neutral, (len(trajectory.times), 1))
        return self.positions(dict(zip(trajectory.joint_names, trajectory.positions.T)))
