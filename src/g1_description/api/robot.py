"""A robot for Python programs."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from functools import cached_property
from os import PathLike
from pathlib import Path
from typing import TYPE_CHECKING, Any, Union

import numpy as np

from g1_description.api.model import RobotModel
from g1_description.api.values import JointValues, as_poses
from g1_description.checks.thresholds import (
    Thresholds,
    read_thresholds,
    with_thresholds,
)
from g1_description.checks.verdict import Verdict
from g1_description.errors import DescriptionError, InvalidValueError, MotionError
from g1_description.motion.files.read import read_motion
from g1_description.motion.files.write import write_motion
from g1_description.motion.motion import Motion, fitted
from g1_description.motion.trajectory import Trajectory
from g1_description.robot.assembly import root_in_base
from g1_description.robot.dynamics import (
    Masses,
    RobotMotion,
    inverse_dynamics,
    link_jacobian,
)
from g1_description.robot.kinematics import Kinematics
from g1_description.robot.rotation import cross
from g1_description.robot.transform import IDENTITY, compose

if TYPE_CHECKING:
    from g1_description.checks.checker import Checker
    from g1_description.collisions.distances import Contacts


class RobotKinematics(RobotModel):
    """A robot whose links can be placed."""

    def forward_kinematics(
        self, positions: JointValues, base: Any = None
    ) -> np.ndarray:
        """Place all links.

        Returns:
            Poses of the link frames in the world in the order of ``link_names``, shape
            (..., n_links, 7).

        Raises:
            G1DescriptionError: If positions or base are none of this robot.
        """
        return self._kinematics.link_poses(*self._placed(positions, base))

    def link_poses(
        self, positions: JointValues, base: Any = None
    ) -> dict[str, np.ndarray]:
        """Place all links: poses by name, shapes (..., 7), else the same."""
        poses = self.forward_kinematics(positions, base)
        return {link: poses[..., row, :] for row, link in enumerate(self.link_names)}

    def jacobian(
        self, link: str, positions: JointValues, base: Any = None
    ) -> np.ndarray:
        """Compute the geometric Jacobian of the origin of a link.

        Returns:
            J such that J @ (base's linear velocity, base's angular velocity, joint
            velocities) is the link's linear, then angular velocity, all along the
            world's axes, shape (..., 6, 6 + n_joints).

        Raises:
            G1DescriptionError: If there is no such link, or positions or base are none
                of this robot.
        """
        row = self.link_row(link)
        roots, placed = self._placed(positions, base)
        found = link_jacobian(self._kinematics, roots, placed, row)
        # Its columns are those of the root, which the base carries along.
        base_row = self.link_names.index(self.base_link)
        bases = self._kinematics.link_poses(roots, placed)[..., base_row, :3]
        lever = (roots[..., :3] - bases)[..., np.newaxis, :]
        shift = cross(np.eye(3), lever)
        found[..., :3, 3:6] += np.swapaxes(shift, -1, -2)
        return found

    def center_of_mass(self, positions: JointValues, base: Any = None) -> np.ndarray:
        """Compute the centre of mass in the world, in [m], shape (..., 3).

        Raises:
            DescriptionError: If the robot has no masses.
            G1DescriptionError: If positions or base are none of this robot.
        """
        return self._masses.robot_center(self.forward_kinematics(positions, base))

    def inverse_dynamics(
        self,
        positions: JointValues,
        velocities: JointValues | None = None,
        accelerations: JointValues | None = None,
        base: Any = None,
    ) -> np.ndarray:
        """Compute the efforts that hold or move the robot while its base is held fast.

        Args:
            positions: Of the joints.
            velocities: In [rad/s] or [m/s], like positions; by default none.
            accelerations: In [rad/s^2] or [m/s^2], likewise.
            base: Pose of the base link.

        Returns:
            Efforts of the joints in [N m] or [N] under gravity along -z, shape
            (..., n_joints).

        Raises:
            DescriptionError: If the robot has no masses.
            G1DescriptionError: If numbers are none of this robot.
        """
        if not self._masses.total > 0.0:
            raise DescriptionError(f"{self.name} has no masses: no effort moves it.")
        root, placed = self._placed(positions, base)
        rates = [
            self._rates(velocities, placed.shape, "velocity"),
            self._rates(accelerations, placed.shape, "acceleration"),
        ]
        still = np.zeros((*placed.shape[:-1], 6))
        motion = RobotMotion(root, placed, still, rates[0], still, rates[1])
        return inverse_dynamics(self._kinematics, self._masses, motion).efforts

    @cached_property
    def _kinematics(self) -> Kinematics:
        return Kinematics(self.description)

    @cached_property
    def _masses(self) -> Masses:
        return Masses(self.description)

    @cached_property
    def _root_in_base(self) -> np.ndarray:
        return root_in_base(self.description)

    def _placed(
        self, positions: JointValues, base: Any
    ) -> tuple[np.ndarray, np.ndarray]:
        """Check positions and base, and give them the same leading axes.

        Returns:
            Poses of the root link, shape (..., 7), and positions, shape
            (..., n_joints).
        """
        placed = self.positions(positions)
        roots = IDENTITY if base is None else as_poses(base)
        if self.base_link != self.description.root:
            roots = compose(roots, self._root_in_base)
        lead = _common(roots.shape[:-1], placed.shape[:-1])
        return (
            np.broadcast_to(roots, (*lead, 7)),
            np.broadcast_to(placed, (*lead, len(self.joint_names))),
        )


def _common(first: tuple[int, ...], second: tuple[int, ...]) -> tuple[int, ...]:
    """Return the leading axes that arrays with these have together.

    Raises:
        InvalidValueError: If they do not go together.
    """
    try:
        return np.broadcast(np.broadcast_to(0, first), np.broadcast_to(0, second)).shape
    except ValueError as error:
        raise InvalidValueError(
            f"The leading axes {first} and {second} do not go together."
        ) from error


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


ThresholdValues = Union[Thresholds, "Mapping[str, Any]", str, "PathLike[str]", None]
"""A YAML file, or what it would hold; None: the defaults."""


class RobotChecks(RobotKinematics, RobotMotions):
    """A robot whose configurations and motions can be judged."""

    def check(
        self,
        motion: Motion | Trajectory | str | PathLike[str],
        only: Collection[str] = (),
        thresholds: ThresholdValues = None,
        fixed_base: bool = False,
    ) -> Verdict:
        """Judge a motion.

        Args:
            motion: The motion, or its file.
            only: Names of the checks to make; none: all.
            thresholds: What is a warning and what a failure: a YAML file, or its
                content such as ``{"skating": {"failure": 0.5}}``.
            fixed_base: Whether something holds the base, so that efforts are known.

        Returns:
            What was found; ``passed`` is False if anything failed.

        Raises:
            G1DescriptionError: If the motion is none of this robot, or there is no such
                check or threshold.
        """
        if isinstance(motion, Trajectory):
            motion = Motion(motion)
        elif not isinstance(motion, Motion):
            motion = self.read_motion(motion)
        motion = fitted(motion, self.description)
        checker = self._checker(thresholds, fixed_base)
        return checker.check_motion(motion, _names(only)).verdict

    def check_state(
        self,
        positions: JointValues,
        base: Any = None,
        only: Collection[str] = (),
        thresholds: ThresholdValues = None,
    ) -> Verdict:
        """Judge a configuration at rest.

        Args:
            positions: Of the joints, shape (n_joints,), or by joint.
            base: Pose of the base link, shape (7,); by default unknown: the floor is
                not judged.
            only: Names of the checks to make; none: all.
            thresholds: As for ``check``.

        Raises:
            G1DescriptionError: If that is no configuration of this robot, or there is
                no such check or threshold.
        """
        placed = self.positions(positions)
        pose = None if base is None else as_poses(base)
        for array, shape in ((placed, (len(self.joint_names),)), (pose, (7,))):
            if array is not None and array.shape != shape:
                raise InvalidValueError(
                    f"An array of shape {array.shape} is given; a configuration has "
                    f"positions of shape ({len(self.joint_names)},) and a base of (7,)."
                )
        checker = self._checker(thresholds, fixed_base=False)
        by_name = dict(zip(self.joint_names, placed.tolist()))
        return checker.check_state(by_name, pose, _names(only))

    def collisions(
        self, positions: JointValues, base: Any = None, margin: float = 0.0
    ) -> Contacts:
        """Find where links touch each other, besides those that may by design.

        Args:
            positions: Of the joints, shape (n, n_joints) or (n_joints,), or by joint.
            base: Poses of the base link, shape (n, 7) or (7,).
            margin: In [m]; links that are nearer are found; 0: those that overlap.

        Returns:
            The contacts; ``frame`` is the row of the configuration, ``pair`` the row of
            the links in ``collision_pairs``, ``distance`` is negative where they
            overlap.

        Raises:
            G1DescriptionError: If that are no configurations of this robot.
        """
        poses = self.forward_kinematics(positions, base)
        poses = poses.reshape(-1, len(self.link_names), 7)
        return self._usual_checker.collisions.contacts(poses, margin)

    @property
    def collision_pairs(self) -> tuple[tuple[str, str], ...]:
        """The pairs of links that are checked for collisions."""
        return self._usual_checker.collisions.pairs

    @cached_property
    def _usual_checker(self) -> Checker:
        """All checks with the usual thresholds; their preparation takes a second."""
        # PyBullet and scipy take a while, and most programs check nothing.
        from g1_description.checks.checker import Checker

        return Checker.of(self.description)

    def _checker(self, given: ThresholdValues, fixed_base: bool) -> Checker:
        """Return the checks with some thresholds."""
        checker = self._usual_checker
        if given is None and not fixed_base:
            return checker
        if given is None:
            thresholds = checker.thresholds
        elif isinstance(given, Thresholds):
            thresholds = given
        elif isinstance(given, Mapping):
            thresholds = with_thresholds(checker.thresholds, given)
        else:
            thresholds = read_thresholds(Path(given).expanduser())
        from g1_description.checks.checker import Checker

        changed = Checker(
            self.description, checker.collisions, thresholds, fixed_base=fixed_base
        )
        changed.notes = checker.notes
        return changed


def _names(only: Collection[str]) -> Collection[str]:
    """Take a single name as well: as a collection, it is one of letters."""
    return (only,) if isinstance(only, str) else only


class Robot(RobotChecks):
    """A robot, and what can be computed of it.

    Everywhere, ``positions`` may be arrays or dictionaries by joint (see the method
    ``positions``), with any number of leading axes for many configurations at once.
    ``base`` is the pose of the base link in the world, shape (..., 7); by default the
    world's origin.
    """
