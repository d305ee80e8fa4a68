"""What a simulator builds: bodies, the joints between them, and where they begin."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from g1_description.core.text import listed
from g1_description.core.transform import IDENTITY, inverse

from .description import FREE, Description, Link

SCOPE = "::"
"""Separates the name of a model from that of its link or joint."""

WORLD = "world"
"""A root link of this name is the world itself: it is no body and does not move."""


def base_of(description: Description) -> tuple[str, np.ndarray]:
    """Find the link whose pose is the robot's.

    Args:
        description: The robot as its file has it.

    Returns:
        The root link; where that is the world, the first link that floats in it. And
        its pose in the root link, if nothing floats yet, shape (7,).
    """
    if description.root == WORLD:
        for joint in description.joints:
            if joint.parent == WORLD and joint.kind in FREE:
                return joint.child, joint.pose
    return description.root, IDENTITY


def root_in_base(description: Description) -> np.ndarray:
    """Find where the root link is in the base: T_base_root, shape (7,)."""
    base, pose = base_of(description)
    return IDENTITY if base == description.root else inverse(pose)


@dataclass(frozen=True)
class Assembly:
    """A model as Gazebo would simulate it, whether it came as URDF or as SDF."""

    description: Description
    """Bodies with mass and the joints between them, fixed ones only where they are
    kept; its root may be ``WORLD``. The bodies of each tree move on their own."""

    root_poses: np.ndarray = field(default_factory=lambda: np.array([IDENTITY]))
    """Poses of the root links in the model frame, joints at zero, in the order of
    ``Description.roots``, shape (n_trees, 7)."""

    positions: dict[str, float] = field(default_factory=dict)
    """Where joints begin, in [rad] or [m] by name, inside their limits; the others
    begin at zero."""

    canonical: str = ""
    """Link whose pose and twist are the model's; empty: the root, wherever it is."""

    static: bool = False
    """Whether it never moves by itself, nor its joints."""

    nested: tuple[str, ...] = ()
    """Models inside that keep a name of their own, such as ``inner::innermost``; the
    names of what they hold begin with it."""

    left_out: tuple[str, ...] = ()
    """A message for each thing in the file that is not simulated, or not as it is."""

    @property
    def root_pose(self) -> np.ndarray:
        """Pose of the first tree's root link in the model frame, shape (7,)."""
        return self.root_poses[0]

    @property
    def link_names(self) -> tuple[str, ...]:
        """Names of the bodies, in the order of the file."""
        names = self.description.link_names
        if self.description.root != WORLD:
            return names
        return tuple(name for name in names if name != WORLD)

    def inside_limits(self) -> Assembly:
        """Return a copy in which all joints begin inside their limits.

        One that cannot be at zero, and begins nowhere else, begins at the limit that is
        nearest.
        """
        moved = {
            joint.name: float(np.clip(0.0, joint.lower, joint.upper))
            for joint in self.description.movable_joints
            if joint.name not in self.positions
            and not joint.lower <= 0.0 <= joint.upper
        }
        if not moved:
            return self
        begin = listed(f"{name} at {value:g}" for name, value in moved.items())
        return replace(
            self,
            positions={**self.positions, **moved},
            left_out=(*self.left_out, f"joints that cannot be at zero begin: {begin}"),
        )

    def holder(self, name: str) -> str:
        """Return the nested model that holds a thing directly.

        Args:
            name: Of a link, joint or nested model, as this assembly has it.

        Returns:
            One of ``nested``; empty for the outermost model.
        """
        around = [model for model in self.nested if name.startswith(model + SCOPE)]
        return max(around, key=len, default="")

    def with_link(self, link: Link) -> Assembly:
        """Return a copy with a link in place of the one of the same name."""
        links = tuple(
            link if old.name == link.name else old for old in self.description.links
        )
        return replace(self, description=replace(self.description, links=links))
