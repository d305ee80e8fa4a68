"""Posing a robot by hand: links are dragged, and the whole body follows."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from typing import Tuple

import numpy as np

from g1_description.choices import ZERO
from g1_description.collisions.self_collisions import SelfCollisions
from g1_description.errors import InvalidValueError
from g1_description.ik.inverse_kinematics import InverseKinematics
from g1_description.ik.options import IkOptions
from g1_description.ik.results import IkResult
from g1_description.ik.solver import last
from g1_description.motion.edit import mirrored, projected
from g1_description.motion.motion import Motion, configuration
from g1_description.robot.assembly import WORLD, root_in_base
from g1_description.robot.description import Description
from g1_description.robot.kinematics import Kinematics
from g1_description.robot.launch_arguments import FEET
from g1_description.robot.poses import (
    check_pose,
    find_pose,
    fitting_poses,
    pose_positions,
    read_poses,
)
from g1_description.robot.state import RobotState
from g1_description.robot.transform import compose, translation
from g1_description.scenes.scene import Scene
from g1_description.sim.standing import lowest_height, standing_base

IMU = "imu"
"""The only role of a profile whose link is not dragged."""

MAX_UNDO = 100
"""Number of changes that can be undone."""

STEPS = 3
"""Steps of a search between two of its results."""

LAG = 0.5
"""Longest time from a command to the state that has it, in [s]."""

Placed = Tuple[np.ndarray, np.ndarray]
"""Positions of joints, in the order of the robot, and the pose of its base."""


class Posing:
    """The configurations of one robot that is posed by hand."""

    def __init__(
        self,
        description: Description,
        state: Callable[[], RobotState | None],
        command: Callable[[dict[str, float], np.ndarray], object],
    ) -> None:
        """Prepare a robot.

        Args:
            description: The robot.
            state: Returns its present state; None if it is unknown.
            command: Moves it to positions by joint and a pose of its base.
        """
        self._description, self._state, self._send = description, state, command
        self._names = tuple(joint.name for joint in description.movable_joints)
        self._kinematics = Kinematics(description)
        self._T_base_root = root_in_base(description)
        self.inverse = InverseKinematics(description)
        """Inverse kinematics of the robot."""
        self.is_prepared = False
        """Whether collisions can be avoided."""
        self.roles = roles_of(description)
        """Links to be dragged by role."""
        centers = {
            link.name: link.inertial.center_of_mass
            for link in description.links
            if link.inertial is not None
        }
        self.centers = {
            role: centers.get(link, np.zeros(3)) for role, link in self.roles.items()
        }
        """Centres of mass of these links in their frames, shape (3,), or else their
        origins: links of one body may have one origin."""
        self.feet = tuple(foot for foot in FEET if foot in self.roles)
        """Roles of the feet."""
        self.fixed_links = {*self.feet}
        """Roles of the links that stay."""
        self.balance = True
        """Whether the centre of mass stays above the feet that stay."""
        self.avoid_collisions = False
        """Whether links keep away from each other, once ``prepare`` was called, and
        from the objects of the scene."""
        self.scene: Scene | None = None
        """The objects around the robot; None: there are none."""
        self._begin: Placed | None = None
        """Where the robot was when the present drag began."""
        self._now: Placed | None = None
        self._floor = 0.0
        """Height below which no link gets in this drag: that of the map, or lower where
        the robot is lower."""
        self._sent: tuple[Placed, float] | None = None
        """The last command, and its time in [s]."""
        self._undone: list[Placed] = []
        self._past: list[Placed] = []

    def prepare(self, shapes: SelfCollisions) -> None:
        """Take the self-collisions to avoid."""
        self.inverse = InverseKinematics(self._description, lambda: shapes)
        self.is_prepared = True

    @property
    def stands(self) -> bool:
        """Whether a foot stays, above which the robot can balance."""
        return not self.fixed_links.isdisjoint(self.feet)

    @property
    def standing_pose(self) -> str:
        """Name of the pose in which the robot stands, by its profile."""
        robot = self._description
        name = (robot.given_profile or robot.profile).standing_pose
        return name if name in fitting_poses(robot) else ZERO

    def place(self) -> Placed:
        """Return where the robot is.

        Raises:
            InvalidValueError: If that is unknown.
        """
        state = self._state()
        if state is None or state.base_pose is None:
            raise InvalidValueError("The state of the robot or its base is unknown.")
        known = state.positions_by_name
        missing = [name for name in self._names if name not in known]
        if missing:
            raise InvalidValueError(f"The position of {missing[0]} is unknown.")
        return np.array([known[name] for name in self._names]), state.base_pose

    def link_poses(self, state: RobotState) -> dict[str, np.ndarray]:
        """Compute the poses of links in the map, shape (7,), by name.

        Args:
            state: With the pose of the base; unknown joints count as 0.
        """
        known = state.positions_by_name
        positions = np.array([known.get(name, 0.0) for name in self._names])
        assert state.base_pose is not None
        root = compose(state.base_pose, self._T_base_root)
        poses = self._kinematics.link_poses(root, positions)
        return dict(zip(self.inverse.links, poses))

    def handle_poses(self, state: RobotState) -> dict[str, np.ndarray]:
        """Compute where links are grabbed: their centres with their orientations.

        Args:
            state: As for ``link_poses``.

        Returns:
            Poses in the map, shape (7,), by role.
        """
        links = self.link_poses(state)
        return {
            role: compose(links[link], translation(self.centers[role]))
            for role, link in self.roles.items()
        }

    # --- dragging ---

    def drag(
        self, name: str, target: np.ndarray, point: np.ndarray | None = None
    ) -> IkResult:
        """Move the robot so that a link follows; begins a drag if none is going on.

        Args:
            name: Role or name of the link.
            target: Pose in the map, shape (7,), or only a position, shape (3,).
            point: The point of the link that follows, in its frame, shape (3,); None:
                its origin.

        Raises:
            InvalidValueError: If the state of the robot is unknown.
        """
        found = last(self.search(name, target, point))
        self.follow(found)
        return found

    def search(
        self, name: str, target: np.ndarray, point: np.ndarray | None = None
    ) -> Iterator[IkResult]:
        """Search where ``drag`` moves the robot; the arguments and errors are the same.

        Returns:
            The best configuration after each few steps, for ``follow``. They may be
            computed in another thread.
        """
        if self._begin is None or self._now is None:
            self._begin = self._now = self.place()
            self._remember(self._begin)
            lowest = lowest_height(self._description, self._as_motion(self._begin))
            self._floor = min(0.0, lowest)
        link = self.roles.get(name, name)
        fixed = [role for role in self.fixed_links if self.roles[role] != link]
        options = IkOptions(
            fixed_links=fixed,
            balance=self.balance and any(role in self.feet for role in fixed),
            avoid_collisions=self.avoid_collisions and self.is_prepared,
            floor=self._floor,
            base_motion="free",
            scene=self.scene if self.avoid_collisions else None,
            points={} if point is None else {name: point},
        )
        return self.inverse.pieces(
            {name: target}, *self._begin, options, 1, self._now, STEPS
        )

    def follow(self, found: IkResult) -> None:
        """Move to a configuration of a search, also after the end of its drag."""
        placed = found.positions, found.base
        self._now = None if self._begin is None else placed
        self._command(placed)

    def end_drag(self) -> None:
        """End a drag; the next one begins where the robot is then."""
        self._begin = self._now = None

    def _go(self, placed: Placed) -> None:
        """Move to a configuration instead of the searched one."""
        self.end_drag()
        self._command(placed)

    def _command(self, placed: Placed) -> None:
        """Command a configuration."""
        positions, base = placed
        self._sent = placed, time.monotonic()
        self._send(dict(zip(self._names, positions.tolist())), base)

    def _present(self) -> Placed:
        """Return where the robot is, or will be at once."""
        if self._sent is not None and time.monotonic() < self._sent[1] + LAG:
            return self._sent[0]
        return self.place()

    def _as_motion(self, placed: Placed) -> Motion:
        """Return a configuration as a motion of one sample."""
        positions, base = placed
        return configuration(dict(zip(self._names, positions.tolist())), base)

    def _remember(self, placed: Placed) -> None:
        """Let a change be undone."""
        self._past = [*self._past[1 - MAX_UNDO :], placed]
        self._undone.clear()

    # --- whole changes ---

    def go(self, placed: Placed) -> None:
        """Move to a configuration; this can be undone.

        Raises:
            InvalidValueError: If the state of the robot is unknown.
        """
        self._remember(self._present())
        self._go(placed)

    def undo(self) -> None:
        """Take back the last change.

        Raises:
            InvalidValueError: If there is none.
        """
        self._step("undo", self._past, self._undone)

    def redo(self) -> None:
        """Make a change again that was taken back.

        Raises:
            InvalidValueError: If there is none.
        """
        self._step("redo", self._undone, self._past)

    def _step(self, action: str, source: list[Placed], other: list[Placed]) -> None:
        """Move from one list of configurations to the other."""
        if not source:
            raise InvalidValueError(f"There is nothing to {action}.")
        other.append(self._present())
        self._go(source.pop())

    def mirror(self) -> None:
        """Exchange left and right, at the plane y = 0 of the map.

        Raises:
            G1DescriptionError: If the robot is not symmetric.
        """
        other = mirrored(self._as_motion(self._present()), self._description)
        by_name = dict(zip(other.joint_names, other.positions[0].tolist()))
        assert other.base_poses is not None
        turned = np.array([by_name[name] for name in self._names])
        self.go((turned, other.base_poses[0]))

    def reset(self, name: str) -> None:
        """Stand on the floor in a named pose, at the present place and heading.

        Raises:
            G1DescriptionError: If there is no such pose, or it does not fit.
        """
        robot = self._description
        pose = find_pose(name, read_poses(robot))
        check_pose(pose, robot)
        positions = pose_positions(pose, robot)
        upright = standing_base(robot, dict(zip(self._names, positions.tolist())))
        self.go((positions, compose(projected(self.place()[1]), upright)))


def roles_of(robot: Description) -> dict[str, str]:
    """Find the links that can be dragged, by their roles in the profile."""
    profile = robot.given_profile or robot.profile
    names = {*robot.link_names} - {WORLD}
    return {r: n for r, n in profile.links.items() if n in names and r != IMU}
