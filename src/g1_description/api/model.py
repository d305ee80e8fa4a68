"""What a robot is, for Python programs: names, limits, named and random poses."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cached_property
from os import PathLike, fspath
from typing import Union

import numpy as np

from g1_description.api.values import JointValues, as_array
from g1_description.errors import (
    G1DescriptionError,
    InvalidValueError,
    UnknownNameError,
)
from g1_description.robot.assembly import WORLD, base_of
from g1_description.robot.description import Joint
from g1_description.robot.load import absolute_urdf
from g1_description.robot.poses import (
    ZERO,
    Pose,
    check_pose,
    find_pose,
    pose_positions,
    read_poses,
)
from g1_description.robot.urdf import parse_urdf
from g1_description.text import listed, similar_first

MODEL = "package://g1_description/urdf/g1_29dof.urdf"
"""The robot of this package."""

Seed = Union[int, np.random.Generator, None]


class RobotModel:
    """A robot as its file has it.

    Joints are the movable ones. Joints and links have the order of the file. Positions
    are in [rad] or [m], poses are rows of x y z and quaternion x y z w.
    """

    def __init__(self, model: str | PathLike[str] = MODEL) -> None:
        """Read a robot.

        Args:
            model: URDF or xacro file, as a path, ``package://PACKAGE/PATH`` or
                ``file://``; arguments for xacro behind it, ``robot.xacro hand=true``;
                or the text of a URDF, such as the parameter robot_description has.

        Raises:
            DescriptionError: If there is no such file, or no robot in it.
        """
        name = fspath(model)
        text = name if name.lstrip().startswith("<") else absolute_urdf(name)
        self.description = parse_urdf(text)
        """Links and joints with all that was read of them."""
        joints = self.description.movable_joints
        self.name = self.description.name
        self.joint_names = tuple(joint.name for joint in joints)
        self.link_names = tuple(n for n in self.description.link_names if n != WORLD)
        self.base_link = base_of(self.description)[0]
        """The link whose pose is the robot's."""
        self.lower = _each(joints, lambda joint: joint.lower)
        """Least positions, -inf where there is no limit, shape (n_joints,)."""
        self.upper = _each(joints, lambda joint: joint.upper)
        """Greatest positions, likewise."""
        self.velocity_limits = _each(joints, lambda joint: joint.velocity)
        """In [rad/s] or [m/s], inf where there is no limit, shape (n_joints,)."""
        self.effort_limits = _each(joints, lambda joint: joint.effort)
        """In [N m] or [N], likewise."""
        self.mass = self.description.mass
        """In [kg]; None where the file gives no masses."""

    def __repr__(self) -> str:
        """Show what it is."""
        n_joints, n_links = len(self.joint_names), len(self.link_names)
        return f"<Robot {self.name}: {n_joints} joints, {n_links} links>"

    @cached_property
    def neutral(self) -> np.ndarray:
        """All joints at 0, or at the limit that is nearest, shape (n_joints,)."""
        return _frozen(pose_positions(Pose(ZERO), self.description))

    @property
    def pose_names(self) -> tuple[str, ...]:
        """The named poses that this robot can take, the user's own among them."""
        return tuple(n for n, pose in read_poses().items() if self._can_take(pose))

    def pose(self, name: str) -> np.ndarray:
        """Return the positions of a named pose, shape (n_joints,).

        Raises:
            UnknownNameError: If there is none of the name, or it names other joints.
            InvalidValueError: If a position is outside the limits.
        """
        pose = find_pose(name, read_poses())
        check_pose(pose, self.description)
        return pose_positions(pose, self.description)

    def random_configuration(
        self, rng: Seed = None, size: int | tuple[int, ...] = ()
    ) -> np.ndarray:
        """Draw positions, evenly between the limits.

        Args:
            rng: Generator or seed; None: another result each time.
            size: How many, or the leading axes.

        Returns:
            Positions, shape (*size, n_joints); a joint that turns without limits is
            within half a turn of 0, or within a turn of its only limit.

        Raises:
            InvalidValueError: If a joint slides without limits.
        """
        lower, upper = self._ranges
        lead = (size,) if isinstance(size, int) else tuple(size)
        generator = np.random.default_rng(rng)
        return generator.uniform(lower, upper, (*lead, len(lower)))

    def positions(self, given: JointValues) -> np.ndarray:
        """Arrange positions in the order of the joints.

        Args:
            given: An array of shape (..., n_joints), or a dictionary by joint of
                numbers or arrays of shape (...); joints that it does not name are
                neutral.

        Returns:
            A new array, shape (..., n_joints).

        Raises:
            UnknownNameError: If the robot has no joint of a name.
            InvalidValueError: If shapes do not fit, or a number is not finite.
        """
        return as_array(given, self.joint_names, self.neutral)

    def link_row(self, link: str) -> int:
        """Return the place of a link in ``link_names``.

        Raises:
            UnknownNameError: If there is none.
        """
        return _row("link", link, self.link_names)

    def joint_row(self, joint: str) -> int:
        """Return the place of a joint in ``joint_names``.

        Raises:
            UnknownNameError: If there is none.
        """
        return _row("movable joint", joint, self.joint_names)

    def _rates(
        self, given: JointValues | None, shape: tuple[int, ...], what: str
    ) -> np.ndarray:
        """Arrange velocities or accelerations in the order of the joints.

        Args:
            given: As for ``positions``; 0 for joints that are not named, None for all.
            shape: That of the positions they belong to, (..., n_joints).
            what: What they are, for messages.

        Returns:
            An array of that shape.

        Raises:
            G1DescriptionError: As ``positions``, or if shapes do not go together.
        """
        still = np.zeros(len(self.joint_names))
        if given is None:
            return np.broadcast_to(still, shape)
        rates = as_array(given, self.joint_names, still, what)
        try:
            return np.broadcast_to(rates, shape)
        except ValueError as error:
            raise InvalidValueError(
                f"An array of shape {rates.shape} for each {what} does not go with "
                f"positions of shape {shape}."
            ) from error

    @cached_property
    def _ranges(self) -> tuple[np.ndarray, np.ndarray]:
        """Where joints can be drawn, shapes (n_joints,)."""
        rows = [_range(joint) for joint in self.description.movable_joints]
        lower, upper = np.array(rows).reshape(-1, 2).T
        return lower, upper

    def _can_take(self, pose: Pose) -> bool:
        """Return whether the robot can take a pose."""
        try:
            check_pose(pose, self.description)
        except G1DescriptionError:
            return False
        return True


def _range(joint: Joint) -> tuple[float, float]:
    """Return where a joint can be drawn.

    Raises:
        InvalidValueError: If it slides without limits.
    """
    lower, upper = joint.lower, joint.upper
    if np.isfinite(lower) and np.isfinite(upper):
        return lower, upper
    if joint.kind == "prismatic":
        raise InvalidValueError(
            f"{joint.name} slides from {lower:g} to {upper:g}: nothing can be drawn "
            "evenly from that."
        )
    if np.isfinite(lower):
        return lower, lower + 2.0 * np.pi
    if np.isfinite(upper):
        return upper - 2.0 * np.pi, upper
    return -np.pi, np.pi


def _row(kind: str, name: str, names: Sequence[str]) -> int:
    """Find a name.

    Raises:
        UnknownNameError: If it is not there; the message begins with those like it.
    """
    if name not in names:
        known = listed(similar_first(name, names)) or "none"
        raise UnknownNameError(f"There is no {kind} '{name}'; there are {known}.")
    return names.index(name)


def _each(joints: Sequence[Joint], value: Callable[[Joint], float]) -> np.ndarray:
    """Gather a number of each joint, shape (n_joints,)."""
    return _frozen(np.array([value(joint) for joint in joints], dtype=float))


def _frozen(array: np.ndarray) -> np.ndarray:
    """Make an array that nobody changes by mistake."""
    array.setflags(write=False)
    return array
