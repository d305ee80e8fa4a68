"""What a model in the world is made of: its links, joints and trees, by rows."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from g1_description.core.robot.assembly import WORLD, Assembly
from g1_description.core.robot.description import Link
from g1_description.core.robot.kinematics import Kinematics
from g1_description.core.transform import inverse


@dataclass(frozen=True, eq=False)
class Tree:
    """Links of a model that joints hold together."""

    links: np.ndarray
    """Rows of its links in the model, shape (n_links,)."""

    joints: np.ndarray
    """Rows of its movable joints in the model, shape (n_joints,)."""

    root_row: int
    """Row of its root in the model's links; of its first link if that is the world."""

    fixed: bool
    """Whether its root does not move by itself."""

    is_on_world: bool
    """Whether its root is the world itself."""


class Structure:
    """Names, limits and rows of a model's links and joints; the state is elsewhere.

    Links and movable joints keep the order of the file.
    """

    def __init__(self, assembly: Assembly, fixed: bool = False) -> None:
        """Prepare names and rows.

        Args:
            assembly: What the model is made of.
            fixed: Whether the root of its first tree does not move by itself.
        """
        description = assembly.description
        joints = description.movable_joints
        self.link_names = assembly.link_names
        self.joint_names = tuple(joint.name for joint in joints)
        self.lower = np.array([joint.lower for joint in joints])
        self.upper = np.array([joint.upper for joint in joints])
        self._link_rows = _rows(self.link_names)
        self._joint_rows = _rows(self.joint_names)
        self.kinematics = Kinematics(description) if self.link_names else None
        """None where no link is left."""
        self._set_links(assembly)
        is_fixed = fixed or assembly.static or description.root == WORLD
        self.trees = self._find_trees(is_fixed)
        """The trees of its links, in the order of ``Description.roots``."""
        self.T_carrier_model = self._find_model_frame()
        """Pose of the model frame in what carries it, shape (7,)."""

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

    def _set_links(self, assembly: Assembly) -> None:
        """Set what the model is made of, and look up its links' masses."""
        self.assembly = assembly
        self.links = {link.name: link for link in assembly.description.links}
        """What each link is made of, by name; also the world, where it is the root."""
        self.centers = np.zeros((len(self.link_names), 3))
        """Centers of mass in the link frames, in [m], shape (n_links, 3); zero for
        links without mass."""
        for row, name in enumerate(self.link_names):
            inertial = self.links[name].inertial
            if inertial is not None:
                self.centers[row] = inertial.center_of_mass

    def _find_model_frame(self) -> np.ndarray:
        """Find the model frame in what carries it, joints at zero, shape (7,)."""
        if self.kinematics is None or not self.assembly.canonical:
            return inverse(self.assembly.root_pose)
        zero = np.zeros(len(self.joint_names))
        poses = self.kinematics.link_poses(self.assembly.root_poses, zero)
        return inverse(poses[self.canonical_row])

    @property
    def listed_joints(self) -> tuple[str, ...]:
        """Names of all joints of the file that are there, fixed ones too."""
        joints = self.assembly.description.joints
        return tuple(joint.name for joint in joints if joint.listed)

    @property
    def canonical_row(self) -> int:
        """Row of the link whose pose and twist are the model's."""
        canonical = self.assembly.canonical
        return self._link_rows[canonical] if canonical else self.root_row

    @property
    def root_row(self) -> int:
        """Row of the root link; of the first link where that is the world."""
        return self.trees[0].root_row

    def tree_below(self, row: int) -> int | None:
        """Return the number of the tree that a link is the root of, None if of none."""
        rows = [tree.root_row for tree in self.trees]
        return rows.index(row) if row in rows else None

    def joint_row(self, name: str) -> int | None:
        """Return the row of a movable joint, None for any other name."""
        return self._joint_rows.get(name)

    def joint_rows(self, names: Iterable[str]) -> list[int]:
        """Return the rows of those names that are movable joints."""
        rows = map(self._joint_rows.get, names)
        return [row for row in rows if row is not None]

    def replace_link(self, link: Link) -> None:
        """Replace a link by one of another mass; joints and shapes are the same.

        Args:
            link: The link as it is from now on; one of its name is there.
        """
        self._set_links(self.assembly.with_link(link))


def _rows(names: tuple[str, ...]) -> dict[str, int]:
    """Number names in their order."""
    return {name: row for row, name in enumerate(names)}
