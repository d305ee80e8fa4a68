"""A model as it is simulated: bodies, joints, and initial state."""

from __future__ import annotations

from collections import Counter
from collections.abc import Collection
from dataclasses import dataclass, field, replace

import numpy as np

from g1_description.robot.description import FREE, Description, Link
from g1_description.robot.transform import IDENTITY, compose, inverse
from g1_description.robot.tree import below
from g1_description.text import listed

SCOPE = "::"
"""Separates the name of a model from that of its link or joint."""

WORLD = "world"
"""A root link with this name is the world itself, not a body."""

MAP = "map"
"""The usual frame in which a base moves."""

BASE_FRAME = "base_link"
"""The usual frame of a base."""


def base_of(description: Description) -> tuple[str, np.ndarray]:
    """Find the link whose pose is that of the robot.

    Args:
        description: The robot as its file has it.

    Returns:
        The root link, or, if that is the world, the first link that floats in it; and
        its initial pose in the root link, shape (7,).
    """
    if description.root == WORLD:
        for joint in description.joints:
            if joint.parent == WORLD and joint.kind in FREE:
                return joint.child, joint.pose
    return description.root, IDENTITY


def base_frame(
    description: Description,
    base: str = BASE_FRAME,
    fixed: Collection[str] = (WORLD, MAP),
) -> str | None:
    """Return the robot's frame that the map is the parent of.

    Args:
        description: The robot as its file has it.
        base: Name of the frame of the base.
        fixed: Frames that do not move.

    Returns:
        ``base``; the floating base, where ``base`` is a link below it, which has a
        parent already; None where the robot is fixed to the world or the map.
    """
    root, _ = base_of(description)
    if root in fixed:
        return None
    return root if base in description.link_names else base


def root_in_base(description: Description) -> np.ndarray:
    """Return T_base_root, the pose of the root link in the base link, shape (7,)."""
    base, pose = base_of(description)
    return IDENTITY if base == description.root else inverse(pose)


@dataclass(frozen=True)
class Assembly:
    """A model as Gazebo would simulate it, whether it came as URDF or as SDF."""

    description: Description
    """Bodies with mass and the joints between them, including fixed ones that are not
    lumped; its root may be ``WORLD``."""

    root_poses: np.ndarray = field(default_factory=lambda: np.array([IDENTITY]))
    """Poses of the root links in the model frame, joints at zero, in the order of
    ``Description.roots``, shape (n_trees, 7)."""

    positions: dict[str, float] = field(default_factory=dict)
    """Initial positions of joints in [rad] or [m] by name, inside their limits; zero
    for others."""

    canonical: str = ""
    """Link whose pose and twist are the model's; empty: the root."""

    static: bool = False
    """Whether it and its joints never move by themselves."""

    nested: tuple[str, ...] = ()
    """Names of nested models, such as ``inner::innermost``, with which the names of
    their links and joints begin."""

    lumped: dict[str, str] = field(default_factory=dict)
    """Bodies by the names of links that were lumped into them."""

    may_touch: dict[str, frozenset[str]] = field(default_factory=dict)
    """Names of what may touch links, by link."""

    left_out: tuple[str, ...] = ()
    """Messages on elements of the file that are ignored or changed."""

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
        """Return a copy with all initial positions inside the limits.

        A joint without an initial position that cannot be at zero begins at the nearest
        limit.
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
            left_out=(
                *self.left_out,
                "0 is outside the limits of some joints, which "
                f"begin at the nearest limit: {begin}",
            ),
        )

    def holder(self, name: str) -> str:
        """Return the innermost nested model of a name.

        Args:
            name: Name of a link, joint or nested model.

        Returns:
            One of ``nested``; empty for the outermost model.
        """
        around = [model for model in self.nested if name.startswith(model + SCOPE)]
        return max(around, key=len, default="")

    def with_link(self, link: Link) -> Assembly:
        """Return a copy with the link of the same name replaced."""
        links = tuple(
            link if old.name == link.name else old for old in self.description.links
        )
        return replace(self, description=replace(self.description, links=links))


def rigid_frames(
    description: Description, as_lumped: bool = False
) -> dict[str, tuple[str, np.ndarray]]:
    """Find the topmost link that each link is rigidly connected to.

    Args:
        description: Any robot.
        as_lumped: Whether to follow only fixed joints that Gazebo lumps: not those to
            the world, nor those that the file preserves.

    Returns:
        For each link: the topmost link connected by fixed joints, and its pose in that
        link's frame, shape (7,).
    """
    root = description.root
    apart = WORLD if as_lumped and root == WORLD else None
    frames: dict[str, tuple[str, np.ndarray]] = {root: (root, IDENTITY)}
    for joint in below([root], description.joints):
        is_kept = joint.parent == apart or (as_lumped and joint.kept_as)
        if joint.kind == "fixed" and not is_kept:
            body, pose = frames[joint.parent]
            frames[joint.child] = (body, compose(pose, joint.pose))
        else:
            frames[joint.child] = (joint.child, IDENTITY)
    return frames


def reference_links(
    description: Description, available: Collection[str]
) -> dict[str, tuple[str, np.ndarray]]:
    """Find an available link that each link is fixed to.

    Simulators publish some of a robot's links: lumping removes the children of fixed
    joints.

    Args:
        description: The robot as in its file, with its fixed joints.
        available: Names of links with known poses.

    Returns:
        For each link that is available or fixed to an available link: the name of that
        link, and its pose in that link's frame, shape (7,).
    """
    frames = rigid_frames(description)
    known: dict[str, tuple[str, np.ndarray]] = {}
    for link in description.link_names:
        body, pose = frames[link]
        if link in available and body not in known:
            known[body] = (link, inverse(pose))
    found = {}
    for link in description.link_names:
        body, pose = frames[link]
        if link in available:
            found[link] = (link, IDENTITY)
        elif body in known:
            reference, T_reference_body = known[body]
            found[link] = (reference, compose(T_reference_body, pose))
    return found


def bodies_of(description: Description) -> dict[str, str]:
    """Return the topmost link that each link is rigidly connected to, of all trees."""
    return {
        link: top
        for tree in description.trees
        for link, (top, _) in rigid_frames(tree).items()
    }


def limbs_of(description: Description) -> dict[str, str]:
    """Return the limb of each link, named by the first link of the limb.

    A limb is a chain of movable joints up to the next branch, with all links that are
    fixed to it: an arm, a leg, or the waist with the torso. A root is one of its own.
    """
    body = bodies_of(description)
    joints = [*below(description.roots, description.joints)]
    moving = [joint for joint in joints if body[joint.child] == joint.child]
    branches = Counter(body[joint.parent] for joint in moving)
    limb = {root: root for root in description.roots}
    for joint in moving:
        parent = body[joint.parent]
        is_next = branches[parent] == 1 and parent not in description.roots
        limb[joint.child] = limb[parent] if is_next else joint.child
    return {link: limb[top] for link, top in body.items()}
