"""A robot as links and joints, independent of file formats."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from g1_description.robot.profile import Profile, profile_of
from g1_description.robot.rotation import rotate
from g1_description.robot.tree import below
from g1_description.text import listed

MOVABLE = ("revolute", "continuous", "prismatic")
"""Types of joints with one degree of freedom."""

FREE = ("floating", "planar")
"""Types of joints with several degrees of freedom, which Gazebo ignores."""


@dataclass(frozen=True)
class Shape:
    """A visual or collision shape."""

    kind: str
    """One of box, cylinder, capsule, sphere, mesh, plane."""

    size: tuple[float, ...]
    """Box: x, y, z; cylinder: radius, length; capsule: radius, length without its ends;
    sphere: radius; mesh: scale; in [m]; plane: its normal."""

    pose: np.ndarray
    """Shape in the link frame, shape (7,)."""

    filename: str = ""
    """File name of the mesh, as in the file."""

    name: str = ""
    """Name of the visual or collision; may be empty."""

    friction: float | None = None
    """Coefficient of friction, may be infinite; None if not given."""

    restitution: float | None = None
    """Coefficient of restitution; None if not given."""

    color: tuple[float, ...] | None = None
    """Red, green, blue, opacity from 0 to 1; None if not given."""


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
        """Compare all numbers exactly."""
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
    """None if not given: unknown is not zero."""

    visuals: tuple[Shape, ...] = ()
    collisions: tuple[Shape, ...] = ()
    gravity: bool | None = None
    """Whether gravity acts on it; None if not given, which means true."""

    @property
    def has_gravity(self) -> bool:
        """Whether gravity acts on it."""
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
    """Limits in [N m] or [N] and [rad/s] or [m/s]; infinite if not given."""

    damping: float = 0.0
    friction: float = 0.0

    remark: str = ""
    """Message on a difference from the file; usually empty."""

    listed: bool = True
    """False for an artificial joint, which holds a static model together."""

    kept_as: str = ""
    """Type of a fixed joint that is not lumped: fixed, or revolute with zero range;
    empty if it is lumped."""


@dataclass(frozen=True)
class Description:
    """A robot: links and joints, in the order of the file.

    A URDF has one tree. There are several trees if a simulator ignores some joints, or
    an SDF model has unconnected links.
    """

    name: str
    root: str
    """The root link of the first tree."""

    links: tuple[Link, ...]
    joints: tuple[Joint, ...]

    static: bool = False
    """Whether the file declares it static."""

    unread: tuple[str, ...] = ()
    """Messages on ignored shapes and attributes of the file."""

    left_out: tuple[str, ...] = ()
    """Messages on ignored elements for simulators."""

    urdf: str = field(default="", repr=False, compare=False)
    """The file, with the names of meshes as written; empty if it was not URDF."""

    given_profile: Profile | None = field(default=None, repr=False, compare=False)
    """The profile that the user chose; None: the one that fits."""

    @cached_property
    def profile(self) -> Profile:
        """Profile of the robot, without links that it lacks.

        Nor has it points with names of links or roles, which prevail.

        Raises:
            ProfileError: If a profile cannot be read.
        """
        names = [joint.name for joint in self.movable_joints]
        found = self.given_profile or profile_of(self.name, names)
        own = {*self.link_names}
        links = {role: link for role, link in found.links.items() if link in own}
        missing = {role: link for role, link in found.links.items() if link not in own}
        points = {
            name: at
            for name, at in found.points.items()
            if at.link in own and name not in {*own, *links}
        }
        missing = {**found.missing_links, **missing}
        return replace(found, links=links, points=points, missing_links=missing)

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
            Description(
                self.name,
                root,
                tuple(links[root]),
                tuple(joints[root]),
                given_profile=self.given_profile,
            )
            for root in roots
        )

    @property
    def mass(self) -> float | None:
        """Total mass in [kg]; None if the file has no masses."""
        masses = [link.inertial.mass for link in self.links if link.inertial]
        return sum(masses) if masses else None


LIMBS = {
    "leg": ("hip", "thigh", "knee", "calf", "shin", "ankle", "foot", "toe", "leg"),
    "hand": ("hand", "finger", "thumb", "index", "middle", "ring", "little", "pinky"),
    "arm": ("shoulder", "upperarm", "elbow", "forearm", "wrist", "arm"),
    "waist": ("waist", "torso", "spine", "chest"),
    "head": ("head", "neck"),
}
"""Words in names that identify a limb; the first match applies."""

OTHER = "joints"
"""The group of all other joints."""

_SIDES = {"left": "left ", "l": "left ", "right": "right ", "r": "right "}


def limits_of(joints: Iterable[Joint]) -> np.ndarray:
    """Return lower and upper limits in [rad] or [m], shape (2, n_joints)."""
    limits = [(joint.lower, joint.upper) for joint in joints]
    return np.array(limits, dtype=float).reshape(-1, 2).T


def limb_of(name: str) -> str:
    """Return the limb of a joint, such as ``left leg``; ``joints`` if unknown."""
    words = re.findall("[a-z]+", name.lower())
    for limb, parts in LIMBS.items():
        if any(part in words for part in parts):
            sides = (_SIDES[word] for word in words if word in _SIDES)
            return next(sides, "") + limb
    return OTHER


def by_limb(names: Iterable[str]) -> dict[str, list[str]]:
    """Group joints by limb, in the order of their first joints.

    Args:
        names: Names of the joints.

    Returns:
        Names of joints by the name of their limb.
    """
    found: dict[str, list[str]] = {}
    for name in names:
        found.setdefault(limb_of(name), []).append(name)
    return found


def origin_reaches(description: Description) -> dict[str, float]:
    """Compute upper bounds of the distances of link origins from the root's.

    Args:
        description: The robot.

    Returns:
        The length of the chain to each link in [m] by name: the distances between
        joints, and the travel of prismatic joints. Infinite below a prismatic joint
        without limits.
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
    """Compute the largest distance of a joint's child from its parent, in [m]."""
    if joint.kind == "prismatic":
        travel = max(abs(joint.lower), abs(joint.upper))
        return float(np.linalg.norm(joint.pose[:3])) + travel
    # The child turns about a point on the axis.
    origin = joint.pose[:3] + rotate(joint.pose[3:], joint.joint_origin)
    return float(np.linalg.norm(origin) + np.linalg.norm(joint.joint_origin))


def clamped_to_limits(
    clamped: Mapping[str, tuple[float, float]], joints: Iterable[Joint]
) -> str:
    """Format a clause on clamped positions, with a hint if one looks like degrees.

    Args:
        clamped: Requested positions and limits by joint name.
        joints: Joints of the robot.

    Returns:
        A clause; empty if nothing is clamped.
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
