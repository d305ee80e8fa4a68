"""Inverse dynamics: joint efforts and the wrench at the root.

Newton's and Euler's equations of all links, at the world's origin. Source:
Featherstone, Rigid Body Dynamics Algorithms, 2008, chapter 5.
"""

from __future__ import annotations

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass

import numpy as np

from g1_description.errors import DescriptionError
from g1_description.robot.assembly import WORLD
from g1_description.robot.description import Description, Inertial
from g1_description.robot.kinematics import Kinematics
from g1_description.robot.rotation import cross, rotate, to_axes

GRAVITY = 9.8
"""In [m/s^2], of Gazebo's default world; the simulator's default, too."""


class Masses:
    """The mass properties of all links, as arrays in the order of the description.

    Links that carry objects have leading axes, those of a batch.
    """

    def __init__(self, description: Description) -> None:
        """Collect them.

        Args:
            description: The robot. Links without ``<inertial>`` have no mass; a root
                called ``WORLD`` is excluded.
        """
        links = [link for link in description.links if link.name != WORLD]
        self.mass = np.zeros(len(links))
        self.center_of_mass = np.zeros((len(links), 3))
        self.inertia = np.zeros((len(links), 3, 3))
        for row, link in enumerate(links):
            if link.inertial is not None:
                self.mass[row] = link.inertial.mass
                self.center_of_mass[row] = link.inertial.center_of_mass
                self.inertia[row] = link.inertial.inertia
        self._name = description.name

    @property
    def total(self) -> np.ndarray:
        """Return the mass of the robot in [kg], shape (...)."""
        return np.asarray(self.mass.sum(axis=-1))

    @property
    def shares(self) -> np.ndarray:
        """Return masses relative to the total, shape (..., n_links); NaN without."""
        total = self.total
        return self.mass / np.where(total > 0.0, total, np.nan)[..., np.newaxis]

    def carrying(
        self,
        objects: Sequence[Inertial | None],
        carriers: np.ndarray,
        poses: np.ndarray,
    ) -> Masses:
        """Add objects to the links that carry them.

        Args:
            objects: Mass properties of m objects; None: no mass.
            carriers: Rows of links, -1 where none carries the object, shape (n, m).
            poses: T_link_object, shape (n, m, 7).

        Returns:
            With a leading axis of n; these if no object with a mass is carried.
        """
        found, counts = copy(self), (len(carriers), 1, 1, 1)
        for column, one in enumerate(objects):
            rows = np.flatnonzero(carriers[:, column] >= 0)
            if one is None or not one.mass or not len(rows):
                continue
            if found.mass is self.mass:
                found.mass = np.tile(self.mass, counts[:2])
                found.center_of_mass = np.tile(self.center_of_mass, counts[:3])
                found.inertia = np.tile(self.inertia, counts)
            at, pose = (rows, carriers[rows, column]), poses[rows, column]
            own, axes = found.mass[at], to_axes(pose[:, 3:])
            center = pose[:, :3] + rotate(pose[:, 3:], one.center_of_mass)
            apart = center - found.center_of_mass[at]
            share = one.mass / (own + one.mass)
            across = np.cross(np.eye(3), apart[:, np.newaxis])
            found.inertia[at] += axes @ one.inertia @ np.swapaxes(axes, 1, 2)
            found.inertia[at] -= (own * share)[:, None, None] * (across @ across)
            found.center_of_mass[at] += share[:, np.newaxis] * apart
            found.mass[at] += one.mass
        return found

    def mean(self, values: np.ndarray) -> np.ndarray:
        """Return the mean of links' values by their masses, shape (..., 3)."""
        return np.asarray((self.shares[..., np.newaxis, :] @ values)[..., 0, :])

    def centers(self, link_poses: np.ndarray) -> np.ndarray:
        """Compute the links' centres of mass.

        Args:
            link_poses: Poses of all links in the world, shape (..., n_links, 7).

        Returns:
            In the world, in [m], shape (..., n_links, 3).
        """
        return link_poses[..., :3] + rotate(link_poses[..., 3:], self.center_of_mass)

    def robot_center(self, link_poses: np.ndarray) -> np.ndarray:
        """Compute the centre of mass of the robot.

        Args:
            link_poses: Poses of all links in the world, shape (..., n_links, 7).

        Returns:
            In the world, in [m], shape (..., 3).

        Raises:
            DescriptionError: If the robot has no mass.
        """
        if not np.all(self.total > 0.0):
            raise DescriptionError(
                f"{self._name} has no centre of mass: none of its links has a mass."
            )
        return self.mean(self.centers(link_poses))

    def robot_velocity(
        self, link_poses: np.ndarray, link_twists: np.ndarray
    ) -> np.ndarray:
        """Compute the velocity of the robot's centre of mass.

        Args:
            link_poses: Poses of all links in the world, shape (..., n_links, 7).
            link_twists: Twists of their origins along the world's axes, shape
                (..., n_links, 6).

        Returns:
            Along the world's axes, in [m/s], shape (..., 3); NaN without masses.
        """
        levers = self.centers(link_poses) - link_poses[..., :3]
        velocities = link_twists[..., :3] + cross(link_twists[..., 3:], levers)
        return self.mean(velocities)


@dataclass(frozen=True, eq=False)
class RobotMotion:
    """Configurations, velocities and accelerations of a robot with one tree.

    Leading axes of all arrays are those of a batch.
    """

    T_world_root: np.ndarray
    """Poses of the root link in the world, shape (..., 7)."""

    positions: np.ndarray
    """Positions of movable joints in [rad] or [m], shape (..., n_joints)."""

    root_twists: np.ndarray
    """Linear velocities of the root's origin and its angular velocities, along the
    world's axes, in [m/s] and [rad/s], shape (..., 6)."""

    velocities: np.ndarray
    """In [rad/s] or [m/s], shape (..., n_joints)."""

    root_accelerations: np.ndarray
    """Linear accelerations of the root's origin and its angular accelerations, along
    the world's axes, in [m/s^2] and [rad/s^2], shape (..., 6)."""

    accelerations: np.ndarray
    """In [rad/s^2] or [m/s^2], shape (..., n_joints)."""


@dataclass(frozen=True, eq=False)
class Dynamics:
    """Result of inverse dynamics."""

    efforts: np.ndarray
    """Joint efforts with external forces at the root only, in [N m] or [N], shape (...,
    n_joints)."""

    root_wrench: np.ndarray
    """External wrench besides gravity: force, and moment about the world's origin,
    along the world's axes, in [N] and [N m], shape (..., 6)."""

    center_of_mass: np.ndarray
    """In the world, in [m], shape (..., 3)."""

    link_poses: np.ndarray
    """Poses of all links in the world, shape (..., n_links, 7)."""


def inverse_dynamics(
    kinematics: Kinematics,
    masses: Masses,
    motion: RobotMotion,
    gravity: float = GRAVITY,
) -> Dynamics:
    """Compute the efforts and the root's wrench of a motion.

    Args:
        kinematics: Kinematics of a robot with one tree.
        masses: Masses of the same robot.
        motion: The motion.
        gravity: Along -z, in [m/s^2].

    Returns:
        Efforts, wrench, centre of mass and link poses.
    """
    poses, origin, axis = kinematics.place(motion.T_world_root, motion.positions)
    screws = kinematics.joint_screws(origin, axis)
    above = kinematics.joints_above
    moved = screws * motion.velocities[..., np.newaxis]
    twists = above @ moved + _root_twist(motion)[..., np.newaxis, :]
    child = kinematics.child_rows
    changed = screws * motion.accelerations[..., np.newaxis]
    changed += _motion_cross(twists[..., child, :], moved)
    rates = above @ changed + _root_rate(motion)[..., np.newaxis, :]
    centers = masses.centers(poses)
    wrenches = _wrenches(poses, centers, masses, twists, rates, gravity)
    efforts = (screws * (above.T @ wrenches)).sum(axis=-1)
    return Dynamics(efforts, wrenches.sum(axis=-2), masses.mean(centers), poses)


def _root_twist(motion: RobotMotion) -> np.ndarray:
    """Move the root's twist to the world's origin, shape (..., 6)."""
    twist = motion.root_twists.copy()
    twist[..., :3] += cross(motion.T_world_root[..., :3], twist[..., 3:])
    return twist


def _root_rate(motion: RobotMotion) -> np.ndarray:
    """Differentiate the root's twist at the world's origin, shape (..., 6)."""
    rate = motion.root_accelerations.copy()
    linear, angular = motion.root_twists[..., :3], motion.root_twists[..., 3:]
    rate[..., :3] += cross(motion.T_world_root[..., :3], rate[..., 3:])
    rate[..., :3] -= cross(angular, linear)
    return rate


def _motion_cross(twist: np.ndarray, moved: np.ndarray) -> np.ndarray:
    """Compute the spatial cross product of motion vectors, shape (..., 6)."""
    linear = cross(twist[..., 3:], moved[..., :3]) + cross(
        twist[..., :3], moved[..., 3:]
    )
    return np.concatenate([linear, cross(twist[..., 3:], moved[..., 3:])], axis=-1)


def _wrenches(
    poses: np.ndarray,
    centers: np.ndarray,
    masses: Masses,
    twists: np.ndarray,
    rates: np.ndarray,
    gravity: float,
) -> np.ndarray:
    """Compute the wrench on each link, at the world's origin.

    Args:
        poses: Poses of the links, shape (..., n_links, 7).
        centers: Centres of mass in the world, shape (..., n_links, 3).
        masses: Masses of the links.
        twists: At the world's origin, shape (..., n_links, 6).
        rates: Derivatives of the twists, shape (..., n_links, 6).
        gravity: Along -z, in [m/s^2].

    Returns:
        Shape (..., n_links, 6).
    """
    spin, turning = twists[..., 3:], rates[..., 3:]
    speed = twists[..., :3] + cross(spin, centers)
    acceleration = rates[..., :3] + cross(turning, centers) + cross(spin, speed)
    acceleration[..., 2] += gravity
    force = masses.mass[..., np.newaxis] * acceleration
    axes = to_axes(poses[..., 3:])
    inertia = axes @ masses.inertia @ np.swapaxes(axes, -1, -2)
    momentum = (inertia @ spin[..., np.newaxis])[..., 0]
    moment = (inertia @ turning[..., np.newaxis])[..., 0] + cross(spin, momentum)
    return np.concatenate([force, moment + cross(centers, force)], axis=-1)
