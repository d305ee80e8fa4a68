"""URDF text in, robot description out: all that is known about links and joints.

This is the only module that reads URDF, and urdf_parser_py (urdfdom) does the
reading. No joint or link name is known here or anywhere else in code.
"""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from lxml import etree
from urdf_parser_py import urdf
from urdf_parser_py.xml_reflection import core as xml_reflection

from .bounds import checked
from .colors import named_colors, visual_colors
from .errors import DescriptionError
from .rotation import from_rpy, to_axes
from .tree import below, one_root
from .urdf_parts import keep_parts
from .xml import parse_xml, part_at_fault

MOVABLE = ("revolute", "continuous", "prismatic")

FREE = ("floating", "planar")
"""Types of joints that have no single position. Gazebo makes nothing of them."""

# An unknown geometry is a plain Exception.
UNREADABLE = Exception
"""What urdf_parser_py raises for text that is not URDF."""

_LOGGER = logging.getLogger(__name__)
# An attribute that URDF does not know is not worth a line on stderr.
xml_reflection.on_error = _LOGGER.debug


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
    """Coefficient of friction; None where the file gives none."""

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
    has_gravity: bool = True
    """Whether gravity pulls it."""


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

    anchor: np.ndarray = field(default_factory=lambda: np.zeros(3))
    """A point of the axis in the child frame, in [m], shape (3,); zero in URDF."""

    lower: float = -np.inf
    upper: float = np.inf
    """Limits of the position in [rad] or [m]; infinite for continuous joints."""

    effort: float = np.inf
    velocity: float = np.inf
    """Limits in [N m] or [N] and [rad/s] or [m/s]; infinite where none is given."""

    damping: float = 0.0
    friction: float = 0.0

    listed: bool = True
    """False where no file names it: it only holds links of a static model together."""


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
        return tuple(
            Description(
                self.name,
                root,
                tuple(link for link in self.links if owner[link.name] == root),
                tuple(joint for joint in self.joints if owner[joint.child] == root),
            )
            for root in roots
        )

    @property
    def mass(self) -> float | None:
        """Sum of the masses the file gives, in [kg]; None where it gives none."""
        masses = [link.inertial.mass for link in self.links if link.inertial]
        return sum(masses) if masses else None

    def joint_above(self) -> dict[str, Joint]:
        """Map each link but the root to the joint that carries it."""
        return {joint.child: joint for joint in self.joints}


def parse_urdf(text: str) -> Description:
    """Read a robot description.

    Args:
        text: URDF as XML text.

    Returns:
        The robot, checked to be one tree with unit axes and ordered limits. Its name is
        empty where the file gives none.

    Raises:
        DescriptionError: If the text is not XML, not URDF, or not one tree.
    """
    element = parse_xml("robot description", text)
    if element.tag != "robot":
        raise DescriptionError(
            f"The robot description is not URDF, its root is <{element.tag}>."
        )
    named = named_colors(element)
    colors = [tuple(visual_colors(link, named)) for link in element.findall("link")]
    keep_parts(element)
    try:
        robot = urdf.URDF.from_xml_string(etree.tostring(element, encoding="utf-8"))
    except UNREADABLE as error:
        sentence = " ".join(str(error).split())
        place = "" if "ParseError" in sentence else part_at_fault(element, _is_urdf)
        raise DescriptionError(
            f"The robot description is not URDF: {place}{sentence}."
        ) from error
    links = tuple(_link(link, found) for link, found in zip(robot.links, colors))
    joints = tuple(_joint(joint) for joint in robot.joints)
    return Description(robot.name, one_root(robot.name, links, joints), links, joints)


def _is_urdf(robot: etree._Element) -> bool:
    """Tell whether a robot element can be read."""
    try:
        urdf.URDF.from_xml_string(etree.tostring(robot, encoding="utf-8"))
    except UNREADABLE:
        return False
    return True


def _pose(owner: str, origin: urdf.Pose | None) -> np.ndarray:
    """Read an origin element; a missing one, or a missing half, is the identity."""
    xyz = (origin.xyz if origin is not None else None) or [0.0, 0.0, 0.0]
    rpy = (origin.rpy if origin is not None else None) or [0.0, 0.0, 0.0]
    numbers = checked(f"an origin of {owner}", [*xyz, *rpy])
    return np.concatenate([numbers[:3], from_rpy(numbers[3:])])


def _link(link: urdf.Link, colors: Sequence[tuple[float, ...] | None]) -> Link:
    """Read a link element, with the colours of its visual shapes."""
    return Link(
        name=link.name,
        inertial=_inertial(link),
        visuals=tuple(
            replace(_shape(link.name, visual), color=color)
            for visual, color in zip(link.visuals, colors)
        ),
        collisions=tuple(_shape(link.name, shape) for shape in link.collisions),
    )


def _inertial(link: urdf.Link) -> Inertial | None:
    """Read an inertial element, with the tensor turned to the link's axes."""
    element = link.inertial
    if element is None:
        return None
    if element.inertia is None:
        raise DescriptionError(f"Link {link.name} has an inertial without inertia.")
    values = element.inertia
    tensor = np.array(
        [
            [values.ixx, values.ixy, values.ixz],
            [values.ixy, values.iyy, values.iyz],
            [values.ixz, values.iyz, values.izz],
        ]
    )
    checked(f"the inertia of link {link.name}", tensor.ravel().tolist())
    checked(f"the mass of link {link.name}", [element.mass], least=0.0)
    pose = _pose(f"link {link.name}", element.origin)
    axes = to_axes(pose[3:])
    return Inertial(float(element.mass), pose[:3], axes @ tensor @ axes.T)


def _shape(link: str, element: urdf.Visual | urdf.Collision) -> Shape:
    """Read a visual or collision element."""
    geometry = element.geometry
    name = getattr(element, "name", None) or ""
    pose = _pose(f"link {link}", element.origin)
    if isinstance(geometry, urdf.Mesh):
        scale = checked(f"a mesh of link {link}", geometry.scale or [1.0, 1.0, 1.0])
        return Shape("mesh", tuple(scale), pose, geometry.filename, name)
    if isinstance(geometry, urdf.Box):
        kind, size = "box", geometry.size
    elif isinstance(geometry, urdf.Cylinder):
        kind, size = "cylinder", [geometry.radius, geometry.length]
    elif isinstance(geometry, urdf.Sphere):
        kind, size = "sphere", [geometry.radius]
    else:
        raise DescriptionError(f"Link {link} has a shape without a known geometry.")
    sizes = tuple(checked(f"a {kind} of link {link}", size, 0.0))
    return Shape(kind, sizes, pose, name=name)


def _joint(joint: urdf.Joint) -> Joint:
    """Read a joint element."""
    axis = np.array(joint.axis or [1.0, 0.0, 0.0], dtype=float)
    length = np.linalg.norm(axis)
    if joint.type in MOVABLE and not 0.0 < length < np.inf:
        raise DescriptionError(
            f"Joint {joint.name} has no direction: axis {joint.axis}."
        )
    limit, dynamics = joint.limit, joint.dynamics
    if limit is None and joint.type in ("revolute", "prismatic"):
        raise DescriptionError(f"Joint {joint.name} is {joint.type} and has no limit.")
    if limit is not None:
        bounds = [limit.effort, limit.velocity]
        checked(f"the limit of joint {joint.name}", bounds, least=0.0)
    if dynamics is not None:
        numbers = [dynamics.damping or 0.0, dynamics.friction or 0.0]
        checked(f"the dynamics of joint {joint.name}", numbers)
    bounded = limit is not None and joint.type in ("revolute", "prismatic")
    lower = float(limit.lower or 0.0) if bounded else -np.inf
    upper = float(limit.upper or 0.0) if bounded else np.inf
    if not lower <= upper:
        raise DescriptionError(
            f"Joint {joint.name} has its lower limit {lower} above its upper {upper}."
        )
    return Joint(
        name=joint.name,
        kind=joint.type,
        parent=joint.parent,
        child=joint.child,
        pose=_pose(f"joint {joint.name}", joint.origin),
        axis=axis / length if length > 0.0 else axis,
        lower=lower,
        upper=upper,
        effort=float(limit.effort) if limit is not None else np.inf,
        velocity=float(limit.velocity) if limit is not None else np.inf,
        damping=float(dynamics.damping or 0.0) if dynamics is not None else 0.0,
        friction=float(dynamics.friction or 0.0) if dynamics is not None else 0.0,
    )
