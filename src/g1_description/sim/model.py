"""One model in the world: its description and its state as arrays."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from functools import partial
from typing import Callable, Tuple

import numpy as np

from g1_description.bounds import MAX_VALUE
from g1_description.errors import InvalidValueError
from g1_description.motion.playlist import Setpoint
from g1_description.robot.assembly import WORLD, Assembly
from g1_description.robot.description import Link, limits_of
from g1_description.robot.kinematics import Kinematics
from g1_description.robot.rotation import cross, rotate
from g1_description.robot.transform import IDENTITY, compose, inverse


@dataclass(frozen=True, eq=False)
class Tree:
    """Links of a model that joints connect."""

    links: np.ndarray
    """Rows of its links in the model, shape (n_links,)."""

    joints: np.ndarray
    """Rows of its movable joints in the model, shape (n_joints,)."""

    root_row: int
    """Row of its root in the model's links; of its first link if that is the world."""

    fixed: bool
    """Whether its root is fixed."""

    is_on_world: bool
    """Whether its root is the world itself."""


States = Tuple[np.ndarray, np.ndarray]
"""Poses and twists, or positions and velocities, as the arrays of ``Model``."""


@dataclass
class Report:
    """The outcome of a command: ignored, clamped and changed joints."""

    unknown: list[str] = field(default_factory=list)
    """Names that are not a movable joint of the model."""

    clamped: dict[str, tuple[float, float]] = field(default_factory=dict)
    """Requested and set position of each joint that was outside its limits."""

    changed: list[int] = field(default_factory=list)
    """Rows of the movable joints that were not yet at rest at that position."""


class Model:
    """A robot or object in the world: its description and its state.

    Links and movable joints keep the order of the file. Link states are computed from
    those of roots and joints.
    """

    def __init__(
        self, name: str, assembly: Assembly, pose: np.ndarray, fixed: bool = False
    ) -> None:
        """Create a model; it is added to an engine later.

        Args:
            name: Name in the world.
            assembly: Its links and joints, with initial positions.
            pose: Pose of the model frame in the world, shape (7,).
            fixed: Whether the root of its first tree is fixed.
        """
        description = assembly.description
        joints = description.movable_joints
        self.name = name
        self.initial_pose = np.array(pose)
        self.link_names = assembly.link_names
        self.joint_names = tuple(joint.name for joint in joints)
        self.lower, self.upper = limits_of(joints)
        self._link_rows = {name: row for row, name in enumerate(self.link_names)}
        self._joint_rows = {name: row for row, name in enumerate(self.joint_names)}
        self.kinematics = Kinematics(description) if self.link_names else None
        """None without links."""
        self._set_assembly(assembly)
        is_fixed = fixed or assembly.static or description.root == WORLD
        self.trees = self._find_trees(is_fixed)
        """The trees of its links, in the order of ``Description.roots``."""
        rows = [tree.links for tree in self.trees if not tree.fixed]
        self._moving = np.concatenate([np.zeros(0, dtype=int), *rows])
        self.T_carrier_model = self._find_model_frame()
        """Pose of the model frame in the frame of ``carrier_pose``, shape (7,)."""
        self.robot_namespace = ""
        """Namespace given by its spawner; stored only."""
        self.ode_joints: dict[str, dict[str, float]] = {}
        """Properties of set_joint_properties, by joint name and Gazebo's names."""
        self.hull_deviations: dict[str, float] = {}
        """Largest deviation of a simplified hull from its mesh in [m], by file name."""
        self.reset()

    def _set_assembly(self, assembly: Assembly) -> None:
        """Set links and joints, and look up the links' centers of mass."""
        self.assembly = assembly
        self.links = {link.name: link for link in assembly.description.links}
        """Links by name, with the world if it is the root."""
        self.centers = np.zeros((len(self.link_names), 3))
        """Centers of mass in the link frames, in [m], shape (n_links, 3); zero for
        links without mass."""
        for row, name in enumerate(self.link_names):
            inertial = self.links[name].inertial
            if inertial is not None:
                self.centers[row] = inertial.center_of_mass

    def _find_trees(self, fixed: bool) -> tuple[Tree, ...]:
        """Find the trees; only the first one can be fixed."""
        trees: list[Tree] = []
        for tree in self.assembly.description.trees:
            rows = self._link_rows
            links = [rows[name] for name in tree.link_names if name in rows]
            joints = [self._joint_rows[joint.name] for joint in tree.movable_joints]
            first = links[0] if links else 0
            trees.append(
                Tree(
                    links=np.array(links, dtype=int),
                    joints=np.array(joints, dtype=int),
                    root_row=rows.get(tree.root, first),
                    fixed=fixed and not trees,
                    is_on_world=tree.root == WORLD,
                )
            )
        return tuple(trees)

    def _find_model_frame(self) -> np.ndarray:
        """Find ``T_carrier_model``, joints at zero, shape (7,)."""
        if self.kinematics is None or not self.assembly.canonical:
            return inverse(self.assembly.root_pose)
        zero = np.zeros(len(self.joint_names))
        poses = self.kinematics.link_poses(self.assembly.root_poses, zero)
        return inverse(poses[self.canonical_row])

    @property
    def canonical_row(self) -> int:
        """Row of the link that defines the model's pose and twist."""
        canonical = self.assembly.canonical
        return self._link_rows[canonical] if canonical else self.trees[0].root_row

    def joint_row(self, name: str) -> int | None:
        """Return the row of a movable joint, None for any other name."""
        return self._joint_rows.get(name)

    def joint_rows(self, names: Iterable[str]) -> list[int]:
        """Return the rows of those names that are movable joints."""
        return [self._joint_rows[name] for name in names if name in self._joint_rows]

    def replace_link(self, link: Link) -> None:
        """Replace the link of that name by one that differs in mass only."""
        self._set_assembly(self.assembly.with_link(link))

    def reset(self) -> None:
        """Reset roots and joints to their initial state, at rest."""
        self.root_poses = self._initial_root_poses()
        """Poses of the root links in the world, shape (n_trees, 7)."""
        self.root_twists = np.zeros((len(self.trees), 6))
        """Velocities of the root frames' origins and angular velocities, along the
        world's axes, shape (n_trees, 6)."""
        begin = self.assembly.positions
        self.position = np.array([begin.get(name, 0.0) for name in self.joint_names])
        """Positions of the movable joints in [rad] or [m], shape (n_joints,)."""
        self.velocity = np.zeros(len(self.joint_names))
        """Velocities of the movable joints in [rad/s] or [m/s], shape (n_joints,)."""
        self.target = np.array(self.position)
        """Last commanded positions, the motors' targets, shape (n_joints,)."""
        self.commanded = np.full(len(self.joint_names), np.nan)
        """Requested positions, before limits, shape (n_joints,); NaN: no
        command since the reset."""
        self.commanded_base: np.ndarray | None = None
        """Last requested pose of the first root link, shape (7,)."""
        self._links: States | Callable[[], States]
        self._placed: Callable[[], States] | None = None
        self._update_links()

    def _initial_root_poses(self) -> np.ndarray:
        """Compute the initial poses of the roots in the world, shape (n_trees, 7)."""
        roots = self.assembly.root_poses
        return np.array([compose(self.initial_pose, root) for root in roots])

    @property
    def poses(self) -> np.ndarray:
        """Poses of the link frames in the world, shape (n_links, 7)."""
        return self._link_states()[0]

    @property
    def twists(self) -> np.ndarray:
        """Twists of the link frames, along the world's axes, shape (n_links, 6)."""
        return self._link_states()[1]

    @property
    def pose(self) -> np.ndarray:
        """Pose of the model frame in the world, shape (7,)."""
        return compose(self.carrier_pose, self.T_carrier_model)

    @property
    def carrier_pose(self) -> np.ndarray:
        """Pose of the canonical link, if the file names one, else of the first root."""
        if self.assembly.canonical:
            return self.poses[self.canonical_row]
        return self.root_poses[0]

    @property
    def twist(self) -> np.ndarray:
        """Twist of the canonical link's frame, along the world's axes, shape (6,)."""
        return self.twists[self.canonical_row] if self.link_names else np.zeros(6)

    def stop(self) -> None:
        """Zero all velocities."""
        self.root_twists[:] = 0.0
        self.velocity[:] = 0.0
        self._update_links()

    def set_measured_state(
        self, roots: States, joints: States, links: Callable[[], States]
    ) -> None:
        """Set the state computed by physics; targets stay.

        Args:
            roots: Poses, shape (n_trees, 7), and twists, shape (n_trees, 6).
            joints: Positions and velocities, shape (n_joints,) each.
            links: Function that computes poses and twists on demand.
        """
        self.root_poses, self.root_twists = roots
        self.position, self.velocity = joints
        self._links = links

    def _link_states(self) -> States:
        """Return the links' poses and twists, computed on demand."""
        links = self._links
        if callable(links):
            links = self._links = links()
        return links

    def _update_links(self) -> None:
        """Set all links' poses and twists from roots and joints.

        They are computed on demand: often the next step comes first.
        """
        now = self.root_poses, self.root_twists, self.position, self.velocity
        self._links = partial(self._states, *now)

    def _states(
        self,
        roots: np.ndarray,
        root_twists: np.ndarray,
        position: np.ndarray,
        velocity: np.ndarray,
    ) -> States:
        """Compute all links' poses and twists from roots and joints."""
        kinematics = self.kinematics
        if kinematics is None:
            return np.zeros((0, 7)), np.zeros((0, 6))
        if root_twists.any() or velocity.any():
            return kinematics.link_states(roots, position, root_twists, velocity)
        poses = kinematics.link_poses(roots, position)
        return poses, np.zeros((len(self.link_names), 6))

    def states_in_roots(self) -> States:
        """Compute all links' poses and twists in the frames of their roots.

        Returns:
            Poses, shape (n_links, 7), and twists relative to the roots along the
            roots' axes, shape (n_links, 6).
        """
        roots = np.tile(IDENTITY, (len(self.trees), 1))
        still = np.zeros((len(self.trees), 6))
        return self._states(roots, still, self.position, self.velocity)

    def set_positions(self, positions: Mapping[str, float]) -> Report:
        """Teleport joints: the links below move rigidly and stand still.

        Args:
            positions: Positions in [rad] or [m] by joint name; values beyond the
                limits are clamped to them.

        Returns:
            The joints that were ignored, clamped and changed.

        Raises:
            InvalidValueError: If a position is NaN or infinite; nothing is changed.
        """
        report = Report()
        desired: dict[int, float] = {}
        requested: dict[int, float] = {}
        for name, position in positions.items():
            row = self.joint_row(name)
            if row is None:
                report.unknown.append(name)
                continue
            if not abs(position) <= MAX_VALUE:
                raise InvalidValueError(
                    f"the position of {name} must be within +-{MAX_VALUE:g} (got "
                    f"{position})"
                )
            lower, upper = float(self.lower[row]), float(self.upper[row])
            requested[row] = float(position)
            desired[row] = min(max(float(position), lower), upper)
            if desired[row] != position:
                report.clamped[name] = float(position), desired[row]
        report.changed = [
            row
            for row, goal in desired.items()
            if self.velocity[row] or not self.position[row] == self.target[row] == goal
        ]
        if desired:
            self._place_joints(np.array([*desired]), np.array([*desired.values()]))
            self.commanded[[*requested]] = [*requested.values()]
        return report

    def _place_joints(self, rows: np.ndarray, positions: np.ndarray) -> None:
        """Set joints, given by their rows, and stop the links below them.

        Link states are computed on demand: often the next step comes first.
        """
        kinematics = self.kinematics
        if kinematics is None:
            return
        self.position[rows] = positions
        self.target[rows] = positions
        self.velocity[rows] = 0.0
        if self._links is self._placed:  # otherwise they would nest, one per command
            self._link_states()
        # This may be computed from the arrays that were just written: then only the
        # links below these joints differ, whose twists are not used.
        before = self._links
        roots, position = np.array(self.root_poses), np.array(self.position)

        def placed() -> States:
            twists = np.array((before() if callable(before) else before)[1])
            twists[kinematics.links_below(rows)] = 0.0
            return kinematics.link_poses(roots, position), twists

        self._links = self._placed = placed

    def set_moving(self, desired: Setpoint) -> None:
        """Set joints and base with their velocities, as sampled from a motion."""
        self.position[desired.rows] = self.target[desired.rows] = desired.positions
        self.velocity[desired.rows] = desired.velocities
        if desired.base_pose is not None:
            self.root_poses[0] = desired.base_pose
            self.root_twists[0] = desired.base_twist
        self._update_links()

    def set_root(self, number: int, pose: np.ndarray, twist: np.ndarray) -> None:
        """Set pose and twist of a root frame; its joints keep their velocities.

        Args:
            number: Index of the tree.
            pose: In the world, shape (7,).
            twist: Velocity of its origin and angular velocity, along the world's axes,
                shape (6,).
        """
        self.root_poses[number], self.root_twists[number] = pose, twist
        self._update_links()

    def set_joint(self, row: int, position: float, velocity: float) -> None:
        """Set position, clamped to its limits, and velocity of a movable joint.

        Args:
            row: Row of the joint.
            position: In [rad] or [m].
            velocity: In [rad/s] or [m/s].
        """
        self.position[row] = np.clip(position, self.lower[row], self.upper[row])
        self.target[row] = self.commanded[row] = self.position[row]
        self.velocity[row] = velocity
        self._update_links()

    def set_state(self, pose: np.ndarray, twist: np.ndarray) -> None:
        """Set pose and velocity of the model; joint positions stay.

        Args:
            pose: Pose of the model frame in the world, shape (7,).
            twist: Linear velocity given to each link's center of mass and angular
                velocity given to each link, along the world's axes, shape (6,).
                Fixed trees ignore it.
        """
        T_model_roots = self.assembly.root_poses
        if self.assembly.canonical or len(self.trees) > 1:
            T_model_roots = compose(inverse(self.pose), self.root_poses)
        for number, T_model_root in enumerate(T_model_roots):
            self._place_root(number, compose(pose, T_model_root))
        self._update_links()
        if twist.any() and len(self._moving):
            linear = twist[:3] - cross(twist[3:], self._levers())
            self.twists[self._moving, :3] = linear[self._moving]
            self.twists[self._moving, 3:] = twist[3:]
            for number, tree in enumerate(self.trees):
                if not tree.fixed:
                    self.root_twists[number] = self.twists[tree.root_row]

    def set_root_state(
        self, pose: np.ndarray, twist: np.ndarray, number: int = 0
    ) -> None:
        """Set pose and velocity of a tree by its root link; its joints stop.

        Args:
            pose: Pose of the root link in the world, shape (7,).
            twist: Velocity of the root link's center of mass and its angular
                velocity, along the world's axes, shape (6,). A fixed tree ignores it.
            number: Index of the tree.
        """
        tree = self.trees[number]
        if tree.is_on_world:
            T_root_link = compose(
                inverse(self.root_poses[number]), self.poses[tree.root_row]
            )
            pose = compose(pose, inverse(T_root_link))
        self._place_root(number, pose)
        self._update_links()
        if not tree.fixed:
            lever = self._levers()[tree.root_row]
            self.root_twists[number] = twist
            self.root_twists[number, :3] -= cross(twist[3:], lever)
            self._update_links()

    def return_home(self) -> None:
        """Reset the pose to that at spawning, at rest; joint positions stay."""
        begin = self.assembly.positions
        initial = np.array([begin.get(name, 0.0) for name in self.joint_names])
        is_valid = np.isfinite(self.position)
        self.position[:] = np.where(is_valid, self.position, initial)
        self.set_state(self.initial_pose, np.zeros(6))
        self.commanded_base = None
        if len(self.trees) > 1:
            self.root_poses[1:] = self._initial_root_poses()[1:]
            self._update_links()

    def _place_root(self, number: int, pose: np.ndarray) -> None:
        """Set the pose of a root link in the world, and stop its tree."""
        self.root_poses[number] = pose
        self.velocity[self.trees[number].joints] = 0.0
        self.root_twists[number] = 0.0

    def _levers(self) -> np.ndarray:
        """Turn ``centers`` to the world's axes, shape (n_links, 3)."""
        return rotate(self.poses[:, 3:], self.centers)
