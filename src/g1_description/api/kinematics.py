"""Where a robot's links are, how they move, and what holds them."""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np

from g1_description.core.dynamics.inverse_dynamics import RobotMotion, inverse_dynamics
from g1_description.core.dynamics.jacobian import link_jacobian
from g1_description.core.dynamics.masses import Masses
from g1_description.core.errors import DescriptionError, InvalidValueError
from g1_description.core.robot.assembly import root_in_base
from g1_description.core.robot.kinematics import Kinematics
from g1_description.core.rotation import cross
from g1_description.core.transform import IDENTITY, compose

from .joint_values import JointValues
from .model import RobotModel
from .poses import as_poses


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
