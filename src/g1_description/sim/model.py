"""One model in the world: its state as arrays."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from ..core.assembly import WORLD, Assembly
from ..core.errors import LARGEST, InvalidValueError
from ..core.kinematics import Kinematics
from ..core.rotation import cross, rotate
from ..core.transform import IDENTITY, compose, inverse


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

    def __init__(
        self, name: str, assembly: Assembly, pose: np.ndarray, fixed: bool = False
    ) -> None:
        """Make a model that has no body yet.

        Args:
            name: Name in the world.
            assembly: What it is made of.
            pose: Pose of the model frame in the world, shape (7,).
            fixed: Whether its root does not move by itself.
        """
        self.name = name
        self.assembly = assembly
        self.initial_pose = np.array(pose)
        description = assembly.description
        joints = description.movable_joints
        self.fixed = fixed or assembly.static or description.root == WORLD
        self.link_names = assembly.link_names
        self.joint_names = tuple(joint.name for joint in joints)
        self.lower = np.array([joint.lower for joint in joints])
        self.upper = np.array([joint.upper for joint in joints])
        self._kinematics = Kinematics(description) if self.link_names else None
        self._n_links = len(self.link_names)
        self._T_canonical_model = self._find_model_frame()
        self.robot_namespace = ""
        """Namespace that its spawner gave it; kept as data."""
        self.ode_joints: dict[str, dict[str, float]] = {}
        """What set_joint_properties gave, in Gazebo's words, by joint name."""
        self.rewind()

    @property
    def listed_joints(self) -> tuple[str, ...]:
        """Names of all joints of the file that are there, fixed ones too."""
        joints = self.assembly.description.joints
        return tuple(joint.name for joint in joints if joint.listed)

    @property
    def canonical_row(self) -> int:
        """Which link the model's pose and twist are those of."""
        canonical = self.assembly.canonical
        return self.link_names.index(canonical) if canonical else self.root_row

    @property
    def root_row(self) -> int:
        """Which link is the root; the first where the world is."""
        root = self.assembly.description.root
        return self.link_names.index(root) if root in self.link_names else 0

    def joint_row(self, name: str) -> int:
        """Tell which movable joint a name means; -1 for a fixed one."""
        return self.joint_names.index(name) if name in self.joint_names else -1

    def rewind(self) -> None:
        """Go back to where root and joints began, at rest."""
        self.root_pose = compose(self.initial_pose, self.assembly.root_pose)
        self.root_twist = np.zeros(6)
        begin = self.assembly.positions
        self.position = np.array([begin.get(name, 0.0) for name in self.joint_names])
        self.velocity = np.zeros(len(self.joint_names))
        self.target = np.array(self.position)
        """Where the joints were last set: what motors hold, shape (n_joints,)."""
        self.update()

    @property
    def pose(self) -> np.ndarray:
        """Pose of the model frame in the world, shape (7,)."""
        if self.assembly.canonical:
            return compose(self.poses[self.canonical_row], self._T_canonical_model)
        return compose(self.root_pose, inverse(self.assembly.root_pose))

    @property
    def twist(self) -> np.ndarray:
        """Twist of the canonical link's frame, along the world's axes, shape (6,)."""
        return self.twists[self.canonical_row] if self._n_links else np.zeros(6)

    def _find_model_frame(self) -> np.ndarray:
        """Find the model frame in the canonical link, joints at zero, shape (7,)."""
        if self._kinematics is None:
            return np.array(IDENTITY)
        still = np.zeros(len(self.joint_names))
        poses = self._kinematics.link_poses(self.assembly.root_pose, still)
        return inverse(poses[self.canonical_row])

    def update(self) -> None:
        """Compute all links' poses and twists from the root and the joints."""
        if self._kinematics is None:
            self.poses, self.twists = np.zeros((0, 7)), np.zeros((0, 6))
            return
        if self.root_twist.any() or self.velocity.any():
            self.poses, self.twists = self._kinematics.link_states(
                self.root_pose, self.position, self.root_twist, self.velocity
            )
        else:
            self.poses = self._kinematics.link_poses(self.root_pose, self.position)
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
            if not abs(position) <= LARGEST:
                raise InvalidValueError(
                    f"joint {name} cannot be set to {position}, only to a number "
                    f"within +-{LARGEST:g}"
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
        self.target[joints] = positions
        self.velocity[joints] = 0.0
        self.poses = self._kinematics.link_poses(self.root_pose, self.position)
        self.twists[self._kinematics.links_below(joints)] = 0.0

    def set_state(self, pose: np.ndarray, twist: np.ndarray) -> None:
        """Put the model somewhere, joints as they are.

        Args:
            pose: Pose of the model frame in the world, shape (7,).
            twist: Linear velocity given to each link's center of mass and angular
                velocity given to each link, along the world's axes, shape (6,).
                A fixed model takes none.
        """
        T_model_root = self.assembly.root_pose
        if self.assembly.canonical:
            T_model_root = compose(inverse(self.pose), self.root_pose)
        self._place_root(compose(pose, T_model_root))
        if twist.any() and self._n_links and not self.fixed:
            self.twists[:, 3:] = twist[3:]
            self.twists[:, :3] = twist[:3] - cross(twist[3:], self._levers())
            self.root_twist = np.array(self.twists[self.root_row])

    def set_root_state(self, pose: np.ndarray, twist: np.ndarray) -> None:
        """Put the model somewhere by its root link, joints as they are and at rest.

        Args:
            pose: Pose of the root link in the world, shape (7,).
            twist: Velocity of the root link's center of mass and its angular
                velocity, along the world's axes, shape (6,). A fixed model takes
                none.
        """
        if self.assembly.description.root == WORLD:
            T_root_link = compose(inverse(self.root_pose), self.poses[self.root_row])
            pose = compose(pose, inverse(T_root_link))
        self._place_root(np.array(pose))
        if not self.fixed:
            lever = self._levers()[self.root_row]
            self.root_twist = np.array(twist)
            self.root_twist[:3] -= cross(twist[3:], lever)
            self.update()

    def _place_root(self, pose: np.ndarray) -> None:
        """Put the root link somewhere in the world, with all at rest."""
        self.root_pose = pose
        self.velocity[:] = 0.0
        self.root_twist = np.zeros(6)
        self.update()

    def _levers(self) -> np.ndarray:
        """Find the way from each link frame's origin to its center of mass.

        Returns:
            Along the world's axes, in [m], shape (n_links, 3).
        """
        centers = np.zeros((self._n_links, 3))
        for link in self.assembly.description.links:
            if link.inertial is not None:
                centers[self.link_names.index(link.name)] = link.inertial.center_of_mass
        return rotate(self.poses[:, 3:], centers)
