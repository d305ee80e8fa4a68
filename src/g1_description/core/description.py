"""URDF text in, robot description out: all that is known about links and joints.

This is the only module that reads URDF, and urdf_parser_py (urdfdom) does the
reading. No joint or link name is known here or anywhere else in code.
"""

from __future__ import annotations

import logging
from dataclasses import dataclass, field
from xml.etree.ElementTree import ParseError as XmlError

import numpy as np
from urdf_parser_py import urdf
from urdf_parser_py.xml_reflection import core as xml_reflection

from .errors import DescriptionError
from .rotation import from_rpy, to_axes

MOVABLE = ("revolute", "continuous", "prismatic")

_LOGGER = logging.getLogger(__name__)
# A tag that URDF does not know, such as <mujoco>, is not worth a line on stderr.
xml_reflection.on_error = _LOGGER.debug


@dataclass(frozen=True)
class Shape:
    """A visual or collision shape."""

    kind: str
    """One of box, cylinder, sphere, mesh."""

    size: tuple[float, ...]
    """Box: x, y, z; cylinder: radius, length; sphere: radius; mesh: scale; in [m]."""

    pose: np.ndarray
    """Shape in the link frame, shape (7,)."""

    filename: str = ""
    """Where the mesh lies: as written in the URDF."""


@dataclass(frozen=True)
class Inertial:
    """Mass properties of a link."""

    mass: float
    """In [kg]."""

    center_of_mass: np.ndarray
    """In the link frame, in [m], shape (3,)."""

    inertia: np.ndarray
    """About the center of mass, along the link's axes, in [kg m^2], shape (3, 3)."""


@dataclass(frozen=True)
class Link:
    """A rigid body."""

    name: str
    inertial: Inertial | None = None
    """None where the file gives none: unknown is not zero."""

    visuals: tuple[Shape, ...] = ()
    collisions: tuple[Shape, ...] = ()


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

    lower: float = -np.inf
    upper: float = np.inf
    """Limits of the position in [rad] or [m]; infinite for continuous joints."""

    effort: float = np.inf
    velocity: float = np.inf
    """Limits in [N m] or [N] and [rad/s] or [m/s]; infinite where none is given."""

    damping: float = 0.0
    friction: float = 0.0


@dataclass(frozen=True)
class Description:
    """A robot: a tree of links and joints, in the order of the file."""

    name: str
    root: str
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
    def mass(self) -> float:
        """Sum of the masses the file gives, in [kg]."""
        return sum(link.inertial.mass for link in self.links if link.inertial)

    def joint_above(self) -> dict[str, Joint]:
        """Map each link but the root to the joint that carries it."""
        return {joint.child: joint for joint in self.joints}


def parse_urdf(text: str) -> Description:
    """Read a robot description.

    Args:
        text: URDF as XML text.

    Returns:
        The robot, checked to be one tree with unit axes and ordered limits.

    Raises:
        DescriptionError: If the text is not XML, not URDF, or not one tree.
    """
    try:
        # As bytes: an XML declaration with an encoding is not allowed in str.
        robot = urdf.URDF.from_xml_string(text.encode("utf-8"))
    except XmlError as error:
        raise DescriptionError(f"The robot description is not XML: {error}.") from error
    except (xml_reflection.ParseError, AssertionError, ValueError) as error:
        sentence = " ".join(str(error).split())
        raise DescriptionError(f"The robot description is not URDF: {sentence}.") from (
            error
        )
    links = tuple(_link(link) for link in robot.links)
    joints = tuple(_joint(joint) for joint in robot.joints)
    return Description(robot.name, _root(robot.name, links, joints), links, joints)


def _root(name: str, links: tuple[Link, ...], joints: tuple[Joint, ...]) -> str:
    """Find the root link and check that the joints make one tree."""
    names = [link.name for link in links]
    for kind, listed in (("link", names), ("joint", [joint.name for joint in joints])):
        twice = sorted({entry for entry in listed if listed.count(entry) > 1})
        if twice:
            raise DescriptionError(f"Robot '{name}' has the {kind} {twice[0]} twice.")
    carrier: dict[str, str] = {}
    for joint in joints:
        for role, link in (("parent", joint.parent), ("child", joint.child)):
            if link not in names:
                raise DescriptionError(
                    f"Joint {joint.name} of robot '{name}' has the {role} {link}, "
                    "which is no link of it."
                )
        if joint.child in carrier:
            raise DescriptionError(
                f"Link {joint.child} of robot '{name}' hangs on two joints, "
                f"{carrier[joint.child]} and {joint.name}."
            )
        carrier[joint.child] = joint.name
    roots = [link for link in names if link not in carrier]
    if len(roots) != 1:
        found = " and ".join(roots) if roots else "none (its joints make a loop)"
        raise DescriptionError(f"Robot '{name}' needs one root link, it has {found}.")
    _check_reached(name, roots[0], names, joints)
    return roots[0]


def _check_reached(
    name: str, root: str, names: list[str], joints: tuple[Joint, ...]
) -> None:
    """Check that every link hangs on the root."""
    reached = {root}
    for _ in joints:
        reached |= {joint.child for joint in joints if joint.parent in reached}
    loose = [link for link in names if link not in reached]
    if loose:
        raise DescriptionError(
            f"Link {loose[0]} of robot '{name}' is in a loop of joints, "
            f"not below {root}."
        )


def _pose(origin: urdf.Pose | None) -> np.ndarray:
    """Read an origin element; a missing one, or a missing half, is the identity."""
    xyz = (origin.xyz if origin is not None else None) or [0.0, 0.0, 0.0]
    rpy = (origin.rpy if origin is not None else None) or [0.0, 0.0, 0.0]
    return np.concatenate([np.array(xyz, dtype=float), from_rpy(np.array(rpy))])


def _link(link: urdf.Link) -> Link:
    """Read a link element."""
    return Link(
        name=link.name,
        inertial=_inertial(link),
        visuals=tuple(_shape(link.name, visual) for visual in link.visuals),
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
    if not np.isfinite(tensor).all() or not 0.0 <= element.mass < np.inf:
        raise DescriptionError(
            f"Link {link.name} has a mass of {element.mass} kg and an inertia of "
            f"{tensor.tolist()}, which no body has."
        )
    pose = _pose(element.origin)
    axes = to_axes(pose[3:])
    return Inertial(float(element.mass), pose[:3], axes @ tensor @ axes.T)


def _shape(link: str, element: urdf.Visual | urdf.Collision) -> Shape:
    """Read a visual or collision element."""
    geometry = element.geometry
    pose = _pose(element.origin)
    if isinstance(geometry, urdf.Box):
        return Shape("box", tuple(geometry.size), pose)
    if isinstance(geometry, urdf.Cylinder):
        return Shape("cylinder", (geometry.radius, geometry.length), pose)
    if isinstance(geometry, urdf.Sphere):
        return Shape("sphere", (geometry.radius,), pose)
    if isinstance(geometry, urdf.Mesh):
        scale = tuple(geometry.scale) if geometry.scale else (1.0, 1.0, 1.0)
        return Shape("mesh", scale, pose, geometry.filename)
    raise DescriptionError(f"Link {link} has a shape without a known geometry.")


def _joint(joint: urdf.Joint) -> Joint:
    """Read a joint element."""
    axis = np.array(joint.axis or [1.0, 0.0, 0.0], dtype=float)
    length = np.linalg.norm(axis)
    if joint.type in MOVABLE and not 0.0 < length < np.inf:
        raise DescriptionError(
            f"Joint {joint.name} has no direction: axis {joint.axis}."
        )
    limit, dynamics = joint.limit, joint.dynamics
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
        pose=_pose(joint.origin),
        axis=axis / length if length > 0.0 else axis,
        lower=lower,
        upper=upper,
        effort=float(limit.effort) if limit is not None else np.inf,
        velocity=float(limit.velocity) if limit is not None else np.inf,
        damping=float(dynamics.damping or 0.0) if dynamics is not None else 0.0,
        friction=float(dynamics.friction or 0.0) if dynamics is not None else 0.0,
    )
