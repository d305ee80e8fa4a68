"""A robot's links as frames of a scene, each in the frame of the link above it.

A joint that turns changes one frame: the browser moves all that hangs on it, so a
configuration takes one message per joint that has moved.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from g1_description.robot.assembly import WORLD, root_in_base
from g1_description.robot.description import MOVABLE, Description, Joint
from g1_description.robot.rotation import multiply, rotate
from g1_description.robot.transform import IDENTITY, compose
from g1_description.robot.tree import below

if TYPE_CHECKING:
    from viser import FrameHandle, SceneApi


STILL = 1e-6
"""A joint that has moved by less, in [rad] or [m], is where it was."""

AXES = 0.08
"""Length of the axes of a link's frame, in [m]."""


class LinkTree:
    """The frames of one robot in a scene."""

    def __init__(self, scene: SceneApi, path: str, robot: Description) -> None:
        """Add the frames, all joints at zero.

        Args:
            scene: Where to.
            path: Name of the robot in the scene, such as ``/robots/g1``.
            robot: The robot.
        """
        self._robot = robot
        self._scene = scene
        self._T_base_root = root_in_base(robot)
        self.frames: dict[str, FrameHandle] = {}
        """Frames by link name."""
        self._base = IDENTITY
        self._names: set[str] = set()
        self._add(path, robot.root, self._T_base_root)
        joints = []
        for joint in below([robot.root], robot.joints):
            self._add(self.frames[joint.parent].name, joint.child, joint.pose)
            joints += [joint] if joint.kind in MOVABLE else []
        self._joints = _Joints(joints)
        self._shown = np.zeros(len(joints))

    def _add(self, above: str, link: str, pose: np.ndarray) -> None:
        """Add the frame of a link below another."""
        self.frames[link] = self._scene.add_frame(
            f"{above}/{free_name(link, self._names)}",
            show_axes=False,
            axes_length=AXES,
            axes_radius=0.05 * AXES,
            wxyz=wxyz(pose),
            position=pose[:3],
        )

    def place(self, base: np.ndarray) -> None:
        """Put the robot somewhere.

        Args:
            base: T_map_base, shape (7,).
        """
        if np.array_equal(base, self._base):
            return
        self._base = base
        root = compose(base, self._T_base_root)
        frame = self.frames[self._robot.root]
        frame.position, frame.wxyz = root[:3], wxyz(root)

    def bend(self, positions: Mapping[str, float]) -> None:
        """Set joints.

        Args:
            positions: In [rad] or [m] by name; others stay where they are.
        """
        joints, shown = self._joints, self._shown
        desired = [positions.get(name, old) for name, old in zip(joints.names, shown)]
        rows = np.flatnonzero(np.abs(np.subtract(desired, shown)) > STILL)
        if not rows.size:
            return
        shown[rows] = np.array(desired)[rows]
        poses = joints.poses(rows, shown[rows])
        for row, pose in zip(rows.tolist(), poses):
            frame = self.frames[joints.children[row]]
            if joints.turns[row]:
                frame.wxyz = wxyz(pose)
            if joints.shifts[row]:
                frame.position = pose[:3]

    def show_axes(self, shown: bool) -> None:
        """Show the axes of all links, or none."""
        for link, frame in self.frames.items():
            frame.show_axes = shown and link != WORLD


class _Joints:
    """The movable joints of a robot as arrays."""

    def __init__(self, joints: Sequence[Joint]) -> None:
        self.names = [joint.name for joint in joints]
        self.children = [joint.child for joint in joints]
        self.turns = np.array([j.kind != "prismatic" for j in joints], dtype=bool)
        self._rest = np.array([joint.pose for joint in joints]).reshape(-1, 7)
        axes = np.array([joint.axis for joint in joints]).reshape(-1, 3)
        self._origin = np.array([joint.joint_origin for joint in joints])
        self._origin = self._origin.reshape(-1, 3)
        self.shifts = ~self.turns | self._origin.any(axis=1)
        """Whether the child's origin moves in its parent."""
        self._half = multiply(self._rest[:, 3:], np.pad(axes, ((0, 0), (0, 1))))
        self._slide = rotate(self._rest[:, 3:], axes)
        self._pivot = self._rest[:, :3] + rotate(self._rest[:, 3:], self._origin)

    def poses(self, rows: np.ndarray, positions: np.ndarray) -> np.ndarray:
        """Compute where joints put their children.

        Args:
            rows: Which joints, shape (k,).
            positions: In [rad] or [m], shape (k,).

        Returns:
            T_parent_child, shape (k, 7).
        """
        turns = self.turns[rows]
        half = (0.5 * np.where(turns, positions, 0.0))[:, np.newaxis]
        rotation = np.cos(half) * self._rest[rows, 3:] + np.sin(half) * self._half[rows]
        slid = np.where(turns, 0.0, positions)[:, np.newaxis] * self._slide[rows]
        place = self._pivot[rows] - rotate(rotation, self._origin[rows]) + slid
        return np.concatenate([place, rotation], axis=1)


def free_name(name: str, used: set[str]) -> str:
    """Make a name for a scene that no other has, and add it to those that are used.

    Args:
        name: What it is to be like; slashes have a meaning there.
        used: All names so far.
    """
    plain = name.replace("/", "_") or "_"
    found, number = plain, 1
    while found in used:
        number += 1
        found = f"{plain}_{number}"
    used.add(found)
    return found


def wxyz(pose: np.ndarray) -> tuple[float, float, float, float]:
    """Return the rotation of a pose, shape (7,), with its real part first."""
    x, y, z, w = pose[3:].tolist()
    return w, x, y, z


def pose_of(position: np.ndarray, turn_wxyz: np.ndarray) -> np.ndarray:
    """Return the pose, shape (7,), of a position and a rotation, real part first."""
    w, x, y, z = turn_wxyz
    return np.array([*position, x, y, z, w], dtype=float)
