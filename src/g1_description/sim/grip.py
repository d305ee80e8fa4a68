"""An object that a link carries."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from g1_description.robot.rotation import cross
from g1_description.robot.transform import compose, inverse
from g1_description.sim.model import Model


@dataclass(frozen=True, eq=False)
class Grip:
    """An object that does not move in the frame of a link."""

    carrier: Model
    row: int
    """Row of the link."""

    carried: Model
    tree: int
    """Index of the tree of the object."""

    pose: np.ndarray
    """T_link_root, shape (7,)."""

    given: str = ""
    """The link as its name was given, possibly a role."""

    @property
    def link(self) -> str:
        """Name of the link."""
        return self.carrier.link_names[self.row]

    @property
    def root(self) -> str:
        """Name of the root link of the object."""
        return self.carried.link_names[self.carried.trees[self.tree].root_row]

    def follow(self) -> None:
        """Move the object with the link."""
        pose = compose(self.carrier.poses[self.row], self.pose)
        twist = np.array(self.carrier.twists[self.row])
        lever = pose[:3] - self.carrier.poses[self.row][:3]
        twist[:3] += cross(twist[3:], lever)
        self.carried.set_root(self.tree, pose, twist)

    def renewed(self) -> Grip:
        """Return the grip of the object where it is now."""
        root = self.carried.root_poses[self.tree]
        pose = compose(inverse(self.carrier.poses[self.row]), root)
        return replace(self, pose=pose)
