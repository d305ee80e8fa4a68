"""One model in the world: its state as arrays."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from g1_description.core.errors import LARGEST, InvalidValueError
from g1_description.core.robot.assembly import WORLD, Assembly
from g1_description.core.robot.kinematics import Kinematics
from g1_description.core.rotation import cross, rotate
from g1_description.core.transform import compose, inverse


@dataclass(frozen=True, eq=False)
class Tree:
    """Links of a model that joints hold together."""

    links: np.ndarray
    """Which of the model's links are in it, shape (n_links,)."""

    joints: np.ndarray
    """Which of the model's movable joints are in it, shape (n_joints,)."""

    root_row: int
    """Which of the model's links is the root; the first one where the world is."""

    fixed: bool
    """Whether its root does not move by itself."""

    is_on_world: bool
    """Whether its root is the world itself."""


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
    axes, shape (n_links, 6). They are computed from the roots' states and the
    joint positions, which are what PyBullet knows exactly. ``root_poses`` and
    ``root_twists`` hold the roots' states, a row per tree.
    """

    def __init__(
        self, name: str, assembly: Assembly, pose: np.ndarray, fixed: bool = False
    ) -> None:
        """Make a model that has no body yet.

        Args:
            name: Name in the world.
            assembly: What it is made of.
            pose: Pose of the model frame in the world, shape (7,).
            fixed: Whether the root of its first tree does not move by itself.
        """
        self.name = name
        self.assembly = assembly
        self.initial_pose = np.array(pose)
        description = assembly.description
        joints = description.movable_joints
        self.link_names = assembly.link_names
        self.joint_names = tuple(joint.name for joint in joints)
        self.lower = np.array([joint.lower for joint in joints])
        self.upper = np.array([joint.upper for joint in joints])
        self._kinematics = Kinematics(description) if self.link_names else None
        self._n_links = len(self.link_names)
        fixed = fixed or assembly.static or description.root == WORLD
        self.trees = self._find_trees(fixed)
        """The trees of its links, in the order of ``Description.roots``."""
        rows = [tree.links for tree in self.trees if not tree.fixed]
        self._moving = np.concatenate([np.zeros(0, dtype=int), *rows])
        self.T_carrier_model = self._find_model_frame()
        """Pose of the model frame in what carries it, shape (7,)."""
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
        return self.trees[0].root_row

    def _find_trees(self, fixed: bool) -> tuple[Tree, ...]:
        """Find the trees; only the first one can be fixed."""
        row = {name: number for number, name in enumerate(self.link_names)}
        number = {name: number for number, name in enumerate(self.joint_names)}
        trees: list[Tree] = []
        for tree in self.assembly.description.trees:
            links = [row[name] for name in tree.link_names if name in row]
            joints = [number[joint.name] for joint in tree.movable_joints]
            first = links[0] if links else 0
            trees.append(
                Tree(
                    links=np.array(links, dtype=int),
                    joints=np.array(joints, dtype=int),
                    root_row=row.get(tree.root, first),
                    fixed=fixed and not trees,
                    is_on_world=tree.root == WORLD,
                )
            )
        return tuple(trees)

    def tree_below(self, row: int) -> int | None:
        """Tell which tree has a link for its root; None if none has."""
        rows = [tree.root_row for tree in self.trees]
        return rows.index(row) if row in rows else None

    def joint_row(self, name: str) -> int:
        """Tell which movable joint a name means; -1 for a fixed one."""
        return self.joint_names.index(name) if name in self.joint_names else -1

    def rewind(self) -> None:
        """Go back to where roots and joints began, at rest."""
        self.root_poses = self._initial_root_poses()
        self.root_twists = np.zeros((len(self.trees), 6))
        begin = self.assembly.positions
        self.position = np.array([begin.get(name, 0.0) for name in self.joint_names])
        self.velocity = np.zeros(len(self.joint_names))
        self.target = np.array(self.position)
        """Where the joints were last set: what motors hold, shape (n_joints,)."""
        self.update()

    def _initial_root_poses(self) -> np.ndarray:
        """Give the poses in the world in which the roots began, shape (n_trees, 7)."""
        roots = self.assembly.root_poses
        return np.array([compose(self.initial_pose, root) for root in roots])

    @property
    def pose(self) -> np.ndarray:
        """Pose of the model frame in the world, shape (7,)."""
        return compose(self.carrier_pose, self.T_carrier_model)

    @property
    def carrier_pose(self) -> np.ndarray:
        """Pose in the world of what carries the model frame, shape (7,).

        That is the canonical link where the file names one, else the first root.
        """
        if self.assembly.canonical:
            return self.poses[self.canonical_row]
        return self.root_poses[0]

    @property
    def twist(self) -> np.ndarray:
        """Twist of the canonical link's frame, along the world's axes, shape (6,)."""
        return self.twists[self.canonical_row] if self._n_links else np.zeros(6)

    def _find_model_frame(self) -> np.ndarray:
        """Find the model frame in what carries it, joints at zero, shape (7,)."""
        if self._kinematics is None or not self.assembly.canonical:
            return inverse(self.assembly.root_pose)
        still = np.zeros(len(self.joint_names))
        poses = self._kinematics.link_poses(self.assembly.root_poses, still)
        return inverse(poses[self.canonical_row])

    def stop(self) -> None:
        """Take all velocities for zero."""
        self.root_twists[:] = 0.0
        self.velocity[:] = 0.0
        self.update()

    def update(self) -> None:
        """Compute all links' poses and twists from the roots and the joints."""
        if self._kinematics is None:
            self.poses, self.twists = np.zeros((0, 7)), np.zeros((0, 6))
            return
        if self.root_twists.any() or self.velocity.any():
            self.poses, self.twists = self._kinematics.link_states(
                self.root_poses, self.position, self.root_twists, self.velocity
            )
        else:
            self.poses = self._kinematics.link_poses(self.root_poses, self.position)
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
        self.poses = self._kinematics.link_poses(self.root_poses, self.position)
        self.twists[self._kinematics.links_below(joints)] = 0.0

    def set_joint(self, name: str, position: float, velocity: float) -> None:
        """Put a joint somewhere, inside its limits, and let it move on from there.

        Args:
            name: A movable joint.
            position: In [rad] or [m].
            velocity: In [rad/s] or [m/s].
        """
        row = self.joint_names.index(name)
        self.position[row] = np.clip(position, self.lower[row], self.upper[row])
        self.target[row] = self.position[row]
        self.velocity[row] = velocity
        self.update()

    def set_state(self, pose: np.ndarray, twist: np.ndarray) -> None:
        """Put the model somewhere, joints as they are.

        Args:
            pose: Pose of the model frame in the world, shape (7,).
            twist: Linear velocity given to each link's center of mass and angular
                velocity given to each link, along the world's axes, shape (6,).
                What is fixed takes none.
        """
        T_model_roots = self.assembly.root_poses
        if self.assembly.canonical or len(self.trees) > 1:
            T_model_roots = compose(inverse(self.pose), self.root_poses)
        for number, T_model_root in enumerate(T_model_roots):
            self._place_root(number, compose(pose, T_model_root))
        self.update()
        if twist.any() and len(self._moving):
            linear = twist[:3] - cross(twist[3:], self._levers())
            self.twists[self._moving, :3] = linear[self._moving]
            self.twists[self._moving, 3:] = twist[3:]
            self._take_root_twists()

    def _take_root_twists(self) -> None:
        """Let the roots move as their links do."""
        for number, tree in enumerate(self.trees):
            if not tree.fixed:
                self.root_twists[number] = self.twists[tree.root_row]

    def set_root_state(
        self, pose: np.ndarray, twist: np.ndarray, number: int = 0
    ) -> None:
        """Put a tree somewhere by its root link, joints as they are and at rest.

        Args:
            pose: Pose of the root link in the world, shape (7,).
            twist: Velocity of the root link's center of mass and its angular
                velocity, along the world's axes, shape (6,). What is fixed takes
                none.
            number: Which tree.
        """
        tree = self.trees[number]
        if tree.is_on_world:
            T_root_link = compose(
                inverse(self.root_poses[number]), self.poses[tree.root_row]
            )
            pose = compose(pose, inverse(T_root_link))
        self._place_root(number, pose)
        self.update()
        if not tree.fixed:
            lever = self._levers()[tree.root_row]
            self.root_twists[number] = twist
            self.root_twists[number, :3] -= cross(twist[3:], lever)
            self.update()

    def return_home(self) -> None:
        """Go back to where it was spawned, at rest, joints as they are."""
        self.set_state(self.initial_pose, np.zeros(6))
        if len(self.trees) > 1:
            self.root_poses[1:] = self._initial_root_poses()[1:]
            self.update()

    def _place_root(self, number: int, pose: np.ndarray) -> None:
        """Put a root link somewhere in the world, with all of its tree at rest."""
        self.root_poses[number] = pose
        self.velocity[self.trees[number].joints] = 0.0
        self.root_twists[number] = 0.0

    def _levers(self) -> np.ndarray:
        """Find the way from each link frame's origin to its center of mass.

        Returns:
            Along the world's axes, in [m], shape (n_links, 3).
        """
        centers = np.zeros((self._n_links, 3))
        for link in self.assembly.description.links:
            if link.inertial is not None and link.name in self.link_names:
                centers[self.link_names.index(link.name)] = link.inertial.center_of_mass
        return rotate(self.poses[:, 3:], centers)
