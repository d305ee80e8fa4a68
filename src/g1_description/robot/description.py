"""A robot as links and joints, whatever file it came from."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from g1_description.robot.rotation import rotate
from g1_description.robot.tree import below
from g1_description.text import listed

MOVABLE = ("revolute", "continuous", "prismatic")
"""Types of joints with one degree of freedom."""

FREE = ("floating", "planar")
"""Types of joints that have no single position. Gazebo makes nothing of them."""


@dataclass(frozen=True)
class Shape:
    """A visual or collision shape."""

    kind: str
    """One of box, cylinder, sphere, mesh, plane."""

    size: tuple[float, ...]
    """Box: x, y, z; cylinder: radius, length; sphere: radius; mesh: scale; in [m];
    plane: its normal."""

    pose: np.ndarray
    """Shape in the link frame, shape (7,)."""

    filename: str = ""
    """Where the mesh lies: as written in the file."""

    name: str = ""
    """Name of the visual or collision; empty where the file gives none."""

    friction: float | None = None
    """Coefficient of friction, may be infinite; None where the file gives none."""

    restitution: float | None = None
    """Coefficient of restitution; None where the file gives none."""

    color: tuple[float, ...] | None = None
    """Red, green, blue, opacity from 0 to 1; None where the file gives none."""


@dataclass(frozen=True, eq=False)
class Inertial:
    """Mass properties of a link."""

    mass: float
    """In [kg]."""

    center_of_mass: np.ndarray
    """In the link frame, in [m], shape (3,)."""

    inertia: np.ndarray
    """About the center of mass, along the link's axes, in [kg m^2], shape (3, 3)."""

    def __eq__(self, other: object) -> bool:
        """Compare all numbers to the last bit."""
        return (
            isinstance(other, Inertial)
            and self.mass == other.mass
            and np.array_equal(self.center_of_mass, other.center_of_mass)
            and np.array_equal(self.inertia, other.inertia)
        )

    __hash__ = None  # type: ignore[assignment]


@dataclass(frozen=True)
class Link:
    """A rigid body."""

    name: str
    inertial: Inertial | None = None
    """None where the file gives none: unknown is not zero."""

    visuals: tuple[Shape, ...] = ()
    collisions: tuple[Shape, ...] = ()
    gravity: bool | None = None
    """Whether gravity pulls it; None where the file does not say, and then it does."""

    @property
    def has_gravity(self) -> bool:
        """Whether gravity pulls it."""
        return self.gravity is not False


@dataclass(frozen=True)
class Joint:
    """An edge from a parent link to a child link."""

    name: str
    kind: str
    """URDF's type: revolute, continuous, prismatic, fixed, floating or planar."""

    parent: str
    child: str
    pose: np.ndarray
    """T_parent_child at position zero, shape (7,)."""

    axis: np.ndarray = field(default_factory=lambda: np.array([1.0, 0.0, 0.0]))
    """Unit axis in the child frame, shape (3,)."""

    joint_origin: np.ndarray = field(default_factory=lambda: np.zeros(3))
    """Origin of the joint's own frame, a point of its axis, in the child frame, in [m],
    shape (3,); zero in URDF."""

    lower: float = -np.inf
    upper: float = np.inf
    """Limits of the position in [rad] or [m]; infinite for continuous joints."""

    effort: float = np.inf
    velocity: float = np.inf
    """Limits in [N m] or [N] and [rad/s] or [m/s]; infinite where none is given."""

    damping: float = 0.0
    friction: float = 0.0

    remark: str = ""
    """A message on where it differs from what the file says; empty for most."""

    listed: bool = True
    """False for a joint that no file has: it only holds a static model together."""

    kept_as: str = ""
    """What a fixed joint is where others are lumped: fixed, or revolute without any
    way to turn; empty where it is lumped too."""


@dataclass(frozen=True)
class Description:
    """A robot: links and joints, in the order of the file.

    Joints make one tree of what a URDF has. A simulator makes nothing of some joints,
    and an SDF model may have links that are not joined: then there are several trees.
    """

    name: str
    root: str
    """The root link of the tree, of the first one where there are several."""

    links: tuple[Link, ...]
    joints: tuple[Joint, ...]

    static: bool = False
    """Whether its file says that it never moves by itself, nor its joints."""

    left_out: tuple[str, ...] = ()
    """A message for each thing in its file for simulators that is not read."""

    @property
    def movable_joints(self) -> tuple[Joint, ...]:
        """Joints with one degree of freedom, in the order of the file."""
        return tuple(joint for joint in self.joints if joint.kind in MOVABLE)

    @property
    def link_names(self) -> tuple[str, ...]:
        """Names of all links, in the order of the file."""
        return tuple(link.name for link in self.links)

    @property
    def roots(self) -> tuple[str, ...]:
        """The root links of all trees, ``root`` first."""
        carried = {self.root, *(joint.child for joint in self.joints)}
        free = (name for name in self.link_names if name not in carried)
        return (self.root, *free)

    @cached_property
    def trees(self) -> tuple[Description, ...]:
        """Each tree as a robot of its own, in the order of ``roots``."""
        roots = self.roots
        if len(roots) == 1:
            return (self,)
        owner = {root: root for root in roots}
        for joint in below(roots, self.joints):
            owner[joint.child] = owner[joint.parent]
        links: dict[str, list[Link]] = {root: [] for root in roots}
        for link in self.links:
            links[owner[link.name]].append(link)
        joints: dict[str, list[Joint]] = {root: [] for root in roots}
        for joint in self.joints:
            joints[owner[joint.child]].append(joint)
        return tuple(
            Description(self.name, root, tuple(links[root]), tuple(joints[root]))
            for root in roots
        )

    @property
    def mass(self) -> float | None:
        """Sum of the masses the file gives, in [kg]; None where it gives none."""
        masses = [link.inertial.mass for link in self.links if link.inertial]
        return sum(masses) if masses else None


LIMBS = {
    "leg": ("hip", "thigh", "knee", "calf", "shin", "ankle", "foot", "toe", "leg"),
    "hand": ("hand", "finger", "thumb", "index", "middle", "ring", "little", "pinky"),
    "arm": ("shoulder", "upperarm", "elbow", "forearm", "wrist", "arm"),
    "waist": ("waist", "torso", "spine", "chest"),
    "head": ("head", "neck"),
}
"""Words that tell a limb, the first limb that fits counts: a hand has a wrist, too."""

OTHER = "joints"
"""The group of joints whose names tell nothing."""

_SIDES = {"left": "left ", "l": "left ", "right": "right ", "r": "right "}


def limb_of(name: str) -> str:
    """Name the limb of a joint, such as ``left leg``; ``joints`` if it has none."""
    words = re.findall("[a-z]+", name.lower())
    for limb, parts in LIMBS.items():
        if any(part in words for part in parts):
            sides = (_SIDES[word] for word in words if word in _SIDES)
            return next(sides, "") + limb
    return OTHER


def by_limb(names: Iterable[str]) -> dict[str, list[str]]:
    """Group joints by limb, in the order in which they come.

    Args:
        names: Of the joints.

    Returns:
        Names of joints by the name of their limb.
    """
    found: dict[str, list[str]] = {}
    for name in names:
        found.setdefault(limb_of(name), []).append(name)
    return found


def origin_reaches(description: Description) -> dict[str, float]:
    """Bound how far each link's origin can be from the root's.

    Args:
        description: The robot.

    Returns:
        The length of the chain to each link in [m] by name: the ways from joint to
        joint, and how far those that slide can. No configuration has it farther away,
        few have it so far. Infinite below a joint that slides without limits.
    """
    above = {joint.child: joint for joint in description.joints}
    reaches = {description.root: 0.0}
    for link in description.link_names:
        chain = []
        while link not in reaches:
            chain.append(link)
            link = above[link].parent
        for child in reversed(chain):
            joint = above[child]
            reaches[child] = reaches[joint.parent] + _length(joint)
    return reaches


def _length(joint: Joint) -> float:
    """Bound how far a joint's child is from its parent, in [m]."""
    if joint.kind == "prismatic":
        travel = max(abs(joint.lower), abs(joint.upper))
        return float(np.linalg.norm(joint.pose[:3])) + travel
    # The child turns about a point of the axis.
    origin = joint.pose[:3] + rotate(joint.pose[3:], joint.joint_origin)
    return float(np.linalg.norm(origin) + np.linalg.norm(joint.joint_origin))


def clamped_to_limits(
    clamped: Mapping[str, tuple[float, float]], joints: Iterable[Joint]
) -> str:
    """Say which positions are clamped, and whether one looks like degrees.

    Args:
        clamped: By joint name, the position requested and the limit.
        joints: Joints of the robot.

    Returns:
        Part of a sentence; empty if nothing is clamped.
    """
    if not clamped:
        return ""
    values = listed(
        f"{name} from {requested:.10g} to {limit:.10g}"
        for name, (requested, limit) in clamped.items()
    )
    text = f"clamped to the limits: {values}"
    turning = {joint.name for joint in joints if joint.kind == "revolute"}
    for name, (requested, _) in clamped.items():
        if name in turning and 2.0 * math.pi < abs(requested) <= 360.0:
            hint = "looks like degrees, positions are in radians"
            return f"{text} ({requested:.10g} {hint})"
    return text
