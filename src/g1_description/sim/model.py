"""One model in the world: its state as arrays."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from ..core.errors import InvalidValueError
from ..core.kinematics import Kinematics
from ..core.lumping import Lumped
from ..core.rotation import rotate
from ..core.transform import compose, inverse

SCOPE = "::"
"""What stands between a model's name and a link's or joint's."""


@dataclass
class Report:
    """What became of a command: nothing is ignored or changed in silence."""

    unknown: list[str] = field(default_factory=list)
    """Names that are no movable joint of the model."""

    clamped: dict[str, float] = field(default_factory=dict)
    """Joints whose position was outside the limits, with the position set."""


class Model:
    """A robot or thing in the world.

    ``poses`` and ``twists`` hold the state of all links, a row per link in the
    order of the file: poses of the link frames in the world, shape (n_links, 7);
    velocities of the frames' origins and angular velocities along the world's
    axes, shape (n_links, 6). They are computed from the root's state and the
    joint positions, which are what PyBullet knows exactly.
    """

    def __init__(self, name: str, lumped: Lumped, pose: np.ndarray) -> None:
        """Make a model that has no body yet.

        Args:
            name: Name in the world.
            lumped: The robot without fixed joints.
            pose: Pose of the model frame in the world, shape (7,).
        """
        self.name = name
        self.lumped = lumped
        self.initial_pose = np.array(pose)
        description = lumped.description
        self.link_names = description.link_names
        self.joint_names = tuple(joint.name for joint in description.joints)
        self.lower = np.array([joint.lower for joint in description.joints])
        self.upper = np.array([joint.upper for joint in description.joints])
        self._kinematics = Kinematics(description) if description.links else None
        self._n_links = len(description.links)
        self._root_row = (
            list(self.link_names).index(description.root) if (self._n_links) else 0
        )
        self.rewind()

    def rewind(self) -> None:
        """Go back to the pose of the beginning, all joints at zero, at rest."""
        self.root_pose = compose(self.initial_pose, self.lumped.root_pose)
        self.root_twist = np.zeros(6)
        self.position = np.zeros(len(self.joint_names))
        self.velocity = np.zeros(len(self.joint_names))
        self.update()

    @property
    def pose(self) -> np.ndarray:
        """Pose of the model frame in the world, shape (7,)."""
        return compose(self.root_pose, inverse(self.lumped.root_pose))

    @property
    def twist(self) -> np.ndarray:
        """Twist of the root link's frame, along the world's axes, shape (6,)."""
        return self.twists[self._root_row] if self._n_links else np.zeros(6)

    def update(self) -> None:
        """Compute all links' poses and twists from the root and the joints."""
        if self._kinematics is None:
            self.poses, self.twists = np.zeros((0, 7)), np.zeros((0, 6))
            return
        self.poses = self._kinematics.link_poses(self.root_pose, self.position)
        if self.root_twist.any() or self.velocity.any():
            self.twists = self._kinematics.link_twists(
                self.poses, self.root_twist, self.velocity
            )
        else:
            self.twists = np.zeros((self._n_links, 6))

    def set_positions(self, positions: Mapping[str, float]) -> Report:
        """Teleport joints: what hangs below moves rigidly and stands still.

        Args:
            positions: Positions in [rad] or [m] by joint name; values beyond the
                limits are clamped to them.

        Returns:
            What was not obeyed to the letter.

        Raises:
            InvalidValueError: If a position is NaN or infinite; nothing is changed.
        """
        report = Report()
        wanted: dict[int, float] = {}
        for name, position in positions.items():
            if name not in self.joint_names:
                report.unknown.append(name)
                continue
            if not np.isfinite(position):
                raise InvalidValueError(
                    f"joint {name} cannot be set to {position}, only to a finite number"
                )
            index = self.joint_names.index(name)
            wanted[index] = float(
                np.clip(position, self.lower[index], self.upper[index])
            )
            if wanted[index] != position:
                report.clamped[name] = wanted[index]
        if wanted:
            self._place_joints(np.array(list(wanted)), np.array(list(wanted.values())))
        return report

    def _place_joints(self, joints: np.ndarray, positions: np.ndarray) -> None:
        """Set joints, given as indices, and stop the links below them."""
        assert self._kinematics is not None
        self.position[joints] = positions
        self.velocity[joints] = 0.0
        self.poses = self._kinematics.link_poses(self.root_pose, self.position)
        self.twists[self._kinematics.links_below(joints)] = 0.0

    def set_state(self, pose: np.ndarray, twist: np.ndarray) -> None:
        """Put the model somewhere, joints as they are.

        Args:
            pose: Pose of the model frame in the world, shape (7,).
            twist: Linear velocity given to each link's center of mass and angular
                velocity given to each link, along the world's axes, shape (6,).
        """
        self.root_pose = compose(pose, self.lumped.root_pose)
        self.velocity[:] = 0.0
        self.root_twist = np.zeros(6)
        self.update()
        if twist.any() and self._n_links:
            self.twists[:, 3:] = twist[3:]
            self.twists[:, :3] = twist[:3] - np.cross(twist[3:], self._levers())
            self.root_twist = np.array(self.twist)

    def _levers(self) -> np.ndarray:
        """Find the way from each link frame's origin to its center of mass.

        Returns:
            Along the world's axes, in [m], shape (n_links, 3).
        """
        centers = np.zeros((self._n_links, 3))
        for row, link in enumerate(self.lumped.description.links):
            if link.inertial is not None:
                centers[row] = link.inertial.center_of_mass
        return rotate(self.poses[:, 3:], centers)
