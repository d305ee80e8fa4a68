"""Paths that links of a robot have taken."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from g1_description.robot.assembly import WORLD, root_in_base
from g1_description.robot.description import Description
from g1_description.robot.kinematics import Kinematics
from g1_description.robot.transform import compose

if TYPE_CHECKING:
    from viser import LineSegmentsHandle, SceneApi


LASTING = 10.0
"""How long a trail stays, in [s]."""

PERIOD = 0.1
"""Least time between two points of a trail, in [s]."""

MAX_POINTS = round(LASTING / PERIOD)

COLORS = np.array(
    [(214, 69, 65), (31, 119, 180), (44, 160, 44), (255, 127, 14), (148, 103, 189)],
    dtype=np.uint8,
)


class Trails:
    """The trails of the links at the ends of a robot's limbs."""

    def __init__(self, scene: SceneApi, path: str, robot: Description) -> None:
        """Begin without a trail.

        Args:
            scene: Where to.
            path: Name of all trails in the scene.
            robot: The robot.
        """
        self._scene, self._path = scene, path
        self._names = [joint.name for joint in robot.movable_joints]
        self._kinematics = Kinematics(robot)
        links = [name for name in robot.link_names if name != WORLD]
        self._rows = [links.index(name) for name in last_links(robot)]
        self._T_base_root = root_in_base(robot)
        self._points: deque[np.ndarray] = deque(maxlen=MAX_POINTS)
        self._last = -np.inf
        self._lines: LineSegmentsHandle | None = None

    def add(
        self, time: float, base: np.ndarray | None, positions: Mapping[str, float]
    ) -> None:
        """Go on with the trails, if it is time.

        Args:
            time: In [s]; if it goes back, the trails begin again.
            base: T_map_base, shape (7,); without it nothing is added.
            positions: In [rad] or [m] by name; the others count as 0.
        """
        if time < self._last:
            self.clear()
        if base is None or time < self._last + PERIOD:
            return
        self._last = time
        bent = np.array([positions.get(name, 0.0) for name in self._names])
        poses = self._kinematics.link_poses(compose(base, self._T_base_root), bent)
        self._points.append(poses[self._rows, :3])
        if len(self._points) < 2:
            return
        points = np.array(self._points)
        segments = np.stack([points[:-1], points[1:]], axis=2).reshape(-1, 2, 3)
        color = COLORS[np.arange(len(self._rows)) % len(COLORS)]
        colors = np.tile(color[:, np.newaxis], (len(points) - 1, 2, 1))
        if self._lines is not None:
            self._lines.remove()
        self._lines = self._scene.add_line_segments(
            self._path, segments, colors, thickness=0.006
        )

    def clear(self) -> None:
        """Begin again."""
        self._points.clear()
        self._last = -np.inf
        if self._lines is not None:
            self._lines.remove()
            self._lines = None


def last_links(robot: Description) -> list[str]:
    """Name the links that the last joints of limbs move.

    A limb ends in a joint that moves, behind which no other does. Of fingers, which are
    many and close together, the link that carries them counts.
    """
    movable = {joint.name for joint in robot.movable_joints}
    above = {joint.child: joint for joint in robot.joints}
    carries = set()
    for joint in robot.movable_joints:
        link = joint.parent
        while link in above and above[link].name not in movable:
            link = above[link].parent
        carries.add(link)
    ends = [j for j in robot.movable_joints if j.child not in carries]
    parents = [joint.parent for joint in ends]
    return list(
        dict.fromkeys(
            joint.parent if parents.count(joint.parent) > 1 else joint.child
            for joint in ends
        )
    )
