"""Models as MJCF, from our arrays.

Each tree of a model is a body of the world: with a free joint, or a mocap body if its
root is fixed. The frame of a body is that of its link.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import combinations

import numpy as np

from g1_description.bounds import MAX_VALUE
from g1_description.robot.assembly import SCOPE, WORLD
from g1_description.robot.description import Description, Joint, Link, Shape
from g1_description.robot.rotation import axes_to_rpy, from_rpy, from_z, multiply
from g1_description.robot.transform import IDENTITY, compose, inverse
from g1_description.sim.grip import Grip
from g1_description.sim.meshes.hulls import thinned_hulls
from g1_description.sim.meshes.shapes import Mesh, is_there
from g1_description.sim.model import Model
from g1_description.sim.substance import DEFAULT_FRICTION, inertial_of, principal_axes

THICKNESS = 1e-4
"""Thickness of a flat mesh's hull, in [m]: MuJoCo refuses one without volume."""

MIN_SIZE = 1e-9
"""Smallest size of a shape in [m]: MuJoCo refuses zero."""

MAX_FRICTION = 100.0
"""Largest coefficient of friction: files may have an infinite one."""

PRIORITIES = 1e6
"""Priorities per unit of friction: of two shapes, that with the higher priority, i.e.
the lower friction, sets that of the contact, as in ODE."""

ALL, BOUNCING = 2**31 - 1, 2**30
"""The bits of MuJoCo's collision masks that are used, and that of shapes that bounce.
The lowest one is that of the bodies of a single link."""

BITS, CHOSEN = range(1, 30), 14
"""The bits of other models, and how many of them each has: it lacks one of any other's,
as all have different ones. There are 78 million choices."""


class WorldFile:
    """Writes the bodies of models, in the order in which MuJoCo numbers them."""

    def __init__(self) -> None:
        self._meshes: dict[tuple[str, tuple[float, ...], int], str] = {}
        self._assets: list[str] = []
        self._bodies: list[str] = []
        self._n_joints = 0
        self._welds: list[str] = []
        self._excluded: list[str] = []
        self._masks_left = combinations(BITS, CHOSEN)
        self._groups: dict[tuple[str, str], int] = {}
        self.geoms: list[tuple[Model, str]] = []
        """The model and link of each geom."""
        self._bouncing: list[tuple[int, str, float, float]] = []
        """Number, model, restitution and friction of the geoms that bounce."""
        self.restitutions: list[float] = []
        """Restitutions of pairs of geoms that bounce off each other."""
        self.links: list[tuple[Model, str]] = []
        """Model and link of each body but the world."""
        self.centers: dict[tuple[str, str], np.ndarray] = {}
        """Origins of the bodies of free roots in the frames of their links, by model
        and link: their centers of mass, which move straight however fast they spin."""
        self.inertias: list[np.ndarray] = []
        """Principal moments of each body but the world, shape (3,)."""
        self.ranges: list[np.ndarray] = []
        """Limits of each movable joint in [rad] or [m], shape (2,): may be equal."""
        self.deviations: dict[str, float] = {}
        """Largest deviation of a simplified hull in [m], by mesh."""

    def text(self) -> str:
        """Return the file."""
        return "\n".join(
            [
                "<mujoco>",
                '<compiler angle="radian" autolimits="false" fusestatic="false"/>',
                "<asset>",
                *self._assets,
                "</asset><worldbody>",
                *self._bodies,
                "</worldbody><contact>",
                *self._pairs(),
                *self._excluded,
                "</contact><equality>",
                *self._welds,
                "</equality><actuator>",
                *(
                    f'<general joint="j{number}" biastype="affine"/>'
                    for number in range(self._n_joints)
                ),
                "</actuator></mujoco>",
            ]
        )

    def _pairs(self) -> Iterator[str]:
        """Write the pairs that bounce: the lower restitution counts, as in Gazebo."""
        self.restitutions = []
        for one, other in combinations(self._bouncing, 2):
            if one[1] != other[1]:
                self.restitutions.append(min(one[2], other[2]))
                friction = min(one[3], other[3])
                yield (
                    f'<pair geom1="g{one[0]}" geom2="g{other[0]}" '
                    f'friction="{_row([friction, friction, 0.0, 0.0, 0.0])}"/>'
                )

    def add(self, model: Model, meshes: Mapping[str, Mesh]) -> None:
        """Add the trees of a model.

        Args:
            model: The model.
            meshes: The meshes of its collision shapes; shapes of others are ignored.
        """
        trees = model.assembly.description.trees
        for tree, known in zip(trees, model.trees):
            self._bodies += self._tree(model, tree, known.fixed, meshes)

    def weld(self, grip: Grip) -> None:
        """Fix an object of a model that was added to a link of another one."""
        ends = (grip.carrier, grip.link), (grip.carried, grip.root)
        one, other = (f"b{self.links.index(end) + 1}" for end in ends)
        origins = [np.array(IDENTITY) for _ in ends]
        for origin, (model, link) in zip(origins, ends):
            origin[:3] = self.centers.get((model.name, link), np.zeros(3))
        pose = compose(inverse(origins[0]), compose(grip.pose, origins[1]))
        self._welds.append(
            f'<weld body1="{one}" body2="{other}" '
            f'relpose="{_row(pose[:3])} {_wxyz(pose[3:])}"/>'
        )
        self._excluded.append(f'<exclude body1="{one}" body2="{other}"/>')

    def _tree(
        self,
        model: Model,
        tree: Description,
        fixed: bool,
        meshes: Mapping[str, Mesh],
    ) -> Iterator[str]:
        """Write a tree."""
        links = {link.name: link for link in tree.links}
        below: dict[str, list[Joint]] = {}
        for each in tree.joints:
            below.setdefault(each.parent, []).append(each)

        # A stack, as a chain may be longer than Python's calls.
        waiting: list[tuple[str, Joint | None, np.ndarray] | None]
        waiting = [(tree.root, None, np.zeros(3))]
        while waiting:
            found = waiting.pop()
            if found is None:
                yield "</body>"
                continue
            name, joint, above = found
            pose = IDENTITY if joint is None else joint.pose
            mocap = ' mocap="true"' if joint is None and fixed else ""
            place = _row(pose[:3] - above)
            self.links.append((model, name))
            yield (
                f'<body name="b{len(self.links)}" pos="{place}" '
                f'quat="{_wxyz(pose[3:])}"{mocap}>'
            )
            inertial, origin = links[name].inertial, np.zeros(3)
            if joint is None and not fixed and inertial is not None:
                origin = inertial.center_of_mass
            if joint is None:
                self.centers[model.name, name] = origin
            if joint is None and not fixed:
                yield "<freejoint/>"
            elif joint is not None and joint.kind != "fixed":
                yield self._joint(joint)
            yield self._inertial(links[name], origin)
            for shape in links[name].collisions:
                if is_there(shape, meshes):
                    yield from self._geoms(model, links[name], shape, meshes, origin)
            waiting.append(None)
            waiting += [(e.child, e, origin) for e in reversed(below.get(name, []))]

    def _joint(self, joint: Joint) -> str:
        """Write a movable joint; its limits and drive are set after the compilation."""
        is_limited = joint.kind in ("revolute", "prismatic")
        kind = "slide" if joint.kind == "prismatic" else "hinge"
        bounds = np.clip([joint.lower, joint.upper], -MAX_VALUE, MAX_VALUE)
        self.ranges.append(bounds if is_limited else np.zeros(2))
        number, self._n_joints = self._n_joints, self._n_joints + 1
        return (
            f'<joint name="j{number}" type="{kind}" pos="{_row(joint.joint_origin)}" '
            f'axis="{_row(joint.axis)}" range="-1 1" '
            f'limited="{str(is_limited).lower()}"/>'
        )

    def _inertial(self, link: Link, origin: np.ndarray) -> str:
        """Write mass properties; the moments may be beyond what MuJoCo compiles."""
        if link.inertial is None and link.name == WORLD:
            self.inertias.append(np.zeros(3))
            return ""
        inertial = inertial_of(link)
        moments, axes = principal_axes(inertial.inertia)
        self.inertias.append(moments)
        # Replaced after the compilation, which checks the triangle inequality.
        largest = _row(np.full(3, moments.max()))
        return (
            f'<inertial pos="{_row(inertial.center_of_mass - origin)}" '
            f'quat="{_wxyz(from_rpy(axes_to_rpy(axes)))}" mass="{inertial.mass!r}" '
            f'diaginertia="{largest}"/>'
        )

    def _geoms(
        self,
        model: Model,
        link: Link,
        shape: Shape,
        meshes: Mapping[str, Mesh],
        origin: np.ndarray,
    ) -> Iterator[str]:
        """Write a shape, of a mesh the hull of each part."""
        forms = [f'type="{shape.kind}" size="{_size(shape)}"']
        quaternion = shape.pose[3:]
        if shape.kind == "plane":
            quaternion = multiply(quaternion, from_z(np.array(shape.size)))
            forms = ['type="plane" size="0 0 1"']
        elif shape.kind == "mesh":
            names = self._hulls(shape, meshes[shape.filename])
            forms = [f'type="mesh" mesh="{name}"' for name in names]
        friction = DEFAULT_FRICTION if shape.friction is None else shape.friction
        friction = min(friction, MAX_FRICTION)
        kind, affinity = self._masks(model, link, bool(shape.restitution))
        for form in forms:
            number, name = len(self.geoms), ""
            if shape.restitution:
                name = f'name="g{number}" '
                bounce = number, model.name, min(shape.restitution, 1.0), friction
                self._bouncing.append(bounce)
            self.geoms.append((model, link.name))
            yield (
                f'<geom {name}{form} pos="{_row(shape.pose[:3] - origin)}" '
                f'quat="{_wxyz(quaternion)}" contype="{kind}" '
                f'conaffinity="{affinity}" friction="{friction!r} 0 0" '
                f'priority="{round((MAX_FRICTION - friction) * PRIORITIES)}"/>'
            )

    def _masks(self, model: Model, link: Link, bounces: bool) -> tuple[int, int]:
        """Choose type and affinity: links of one model pass through each other.

        As in Gazebo, a nested model counts as another model. The bodies of a single
        link need no mask of their own. Shapes that bounce collide as pairs.
        """
        affinity = ALL & ~BOUNCING if bounces else ALL
        if len(model.link_names) == 1:
            return BOUNCING if bounces else 1, affinity
        scope = model.name, link.name.rpartition(SCOPE)[0]
        if scope not in self._groups:
            self._groups[scope] = sum(2**bit for bit in next(self._masks_left))
        mask = self._groups[scope]
        return BOUNCING if bounces else mask, ALL & ~BOUNCING & ~mask

    def _hulls(self, shape: Shape, mesh: Mesh) -> list[str]:
        """Write the hulls of a mesh, each once per scale; return their names."""
        hulls, deviation = thinned_hulls(mesh, max(map(abs, shape.size)))
        if deviation:
            known = self.deviations.get(shape.filename, 0.0)
            self.deviations[shape.filename] = max(known, deviation)
        names = []
        for part, points in enumerate(hulls):
            key = shape.filename, tuple(shape.size), part
            if key not in self._meshes:
                self._meshes[key] = f"m{len(self._meshes)}"
                scaled = _thick(np.asarray(points, float) * np.array(shape.size))
                vertices = _row(scaled.ravel())
                self._assets.append(
                    f'<mesh name="{self._meshes[key]}" vertex="{vertices}"/>'
                )
            names.append(self._meshes[key])
        return names


def _thick(points: np.ndarray) -> np.ndarray:
    """Give a flat hull, of points with shape (n, 3), a thickness."""
    centered = points - points.mean(axis=0)
    _, _, axes = np.linalg.svd(centered, full_matrices=True)
    thin = [axis for axis in axes if np.ptp(centered @ axis) < THICKNESS]
    for axis in thin:
        points = np.concatenate([points - THICKNESS * axis, points + THICKNESS * axis])
    return points


def _size(shape: Shape) -> str:
    """Write the size of a shape: half of the sides."""
    long = (1.0, 0.5)
    halves = {"box": (0.5,) * 3, "cylinder": long, "capsule": long, "sphere": (1.0,)}
    factors = halves.get(shape.kind, ())
    return _row([max(f * size, MIN_SIZE) for f, size in zip(factors, shape.size)])


def _row(numbers: Iterable[float] | Sequence[float]) -> str:
    """Write numbers that are read back to the last bit."""
    return " ".join(repr(float(number)) for number in numbers)


def _wxyz(quaternion: np.ndarray) -> str:
    """Write a quaternion (x, y, z, w) in MuJoCo's order."""
    x, y, z, w = quaternion
    return _row([w, x, y, z])
