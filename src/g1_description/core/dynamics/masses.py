"""The masses of a robot's links, and where their centre is."""

from __future__ import annotations

import numpy as np

from g1_description.core.errors import DescriptionError
from g1_description.core.robot.assembly import WORLD
from g1_description.core.robot.description import Description
from g1_description.core.rotation import cross, rotate

GRAVITY = 9.81
"""In [m/s^2], as Pinocchio has it; Gazebo's default world has 9.8."""


class Masses:
    """The mass properties of all links, as arrays in the order of the description."""

    def __init__(self, description: Description) -> None:
        """Gather them.

        Args:
            description: The robot. A link without ``<inertial>`` has no mass here, nor
                has a root called ``WORLD``.
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
        self.total = float(self.mass.sum())
        self._name = description.name

    def centers(self, link_poses: np.ndarray) -> np.ndarray:
        """Place the links' centres of mass.

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
        if not self.total > 0.0:
            raise DescriptionError(
                f"{self._name} has no centre of mass: none of its links has a mass."
            )
        return (self.mass / self.total) @ self.centers(link_poses)

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
        total = self.total if self.total > 0.0 else np.nan
        return (self.mass / total) @ velocities
