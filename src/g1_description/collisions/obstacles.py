"""A robot among objects: which links, and objects that they carry, are near others."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import cached_property

import numpy as np

from g1_description.bounds import MAX_VALUE
from g1_description.collisions.contacts import Contacts, ShapeContacts, deepest
from g1_description.collisions.convex_shapes import (
    axes_of,
    link_shapes,
    posed_links,
    robot_shapes,
    turn,
)
from g1_description.collisions.outlines import with_soles
from g1_description.robot.assembly import bodies_of
from g1_description.robot.description import Description
from g1_description.robot.rotation import rotate
from g1_description.robot.transform import IDENTITY
from g1_description.scenes.carried import named_link
from g1_description.scenes.scene import Scene
from g1_description.sim.meshes.hulls import hull_normals

TOLERANCE = 5e-5
"""Largest difference of hulls from their shapes, in [m]."""

FLOOR = "the floor"
"""Name of the floor, which objects may hit while links carry them."""

UP = np.array([0.0, 0.0, 1.0])

FLAT = float(np.cos(np.radians(10.0)))
"""Least upward part of the normal of what something stands on."""


class Obstacles(ShapeContacts):
    """Finds contacts of a robot with the objects of a scene.

    Checked are links with objects, and objects that links carry with other objects and
    with the floor.
    What carries an object, and what may touch it, is not checked with it; each with
    all links that fixed joints connect to it. For carriers, and roles such as
    left_hand, that includes the link to which their joint belongs: the wrist.
    """

    def __init__(
        self, description: Description, scene: Scene, visual_hulls: bool = True
    ) -> None:
        """Read the meshes and prepare the shapes.

        Args:
            description: The robot, with absolute mesh URIs.
            scene: The objects.
            visual_hulls: Whether what has no collision shapes uses the convex hulls of
                its visuals.

        Raises:
            UnknownNameError: If an object is attached to a link that is not there.
        """
        self.scene = scene
        """The objects."""
        of_links, of_robot = robot_shapes(description, visual_hulls, TOLERANCE)
        bodies = [each.link for each in scene.values()]
        of_objects, of_scene = link_shapes(bodies, visual_hulls, TOLERANCE)
        self.notes = tuple(dict.fromkeys((*of_robot, *of_scene, *scene.notes)))
        """Messages on meshes that cannot be read, and other parts that are ignored."""
        links = [link.name for link in posed_links(description)]
        self.names = (*links, *scene, FLOOR)
        """Names of links, then of objects, in the order of their poses, and FLOOR."""
        self.n_links = len(links)
        """How many of them are links."""
        shapes = with_soles(of_links)
        shapes += [replace(s, link=s.link + self.n_links) for s in of_objects]
        self._planes = [
            (row, shape.pose[:3], rotate(shape.pose[3:], np.array(shape.size)))
            for row, body in enumerate(bodies, self.n_links)
            for shape in body.collisions
            if shape.kind == "plane"
        ]
        self._planes.append((len(self.names) - 1, np.zeros(3), UP))
        solid = {shape.link for shape in shapes} | {row for row, _, _ in self._planes}
        super().__init__(shapes, (), len(self.names))
        pairs = [pair for pair in _pairs(description, scene) if solid.issuperset(pair)]
        self._use(pairs)

    def _use(self, pairs: Sequence[tuple[int, int]]) -> None:
        """Choose the pairs that are checked."""
        # No shape pairs for those of planes, whose contacts are computed on their own.
        self._rows = pairs
        self._all = self._shape_pairs(range(len(pairs)))
        self.pairs = tuple((self.names[a], self.names[b]) for a, b in pairs)
        """Names of a link or carried object, and of an object, as in ``Contacts``."""
        self.pair_rows = np.array(pairs, dtype=int).reshape(-1, 2)
        """Their rows in ``names``, shape (n_pairs, 2)."""
        self._plane_pairs = [
            (number, shape, plane)
            for number, pair in enumerate(pairs)
            for plane in self._planes
            if pair[1] == plane[0]
            for shape in self.shapes
            if shape.link == pair[0]
        ]

    @cached_property
    def face_normals(self) -> list[np.ndarray]:
        """Directions of the faces of shapes of objects, each once, shapes (k, 3)."""
        return [
            np.unique(hull_normals(shape.points)[0].round(9), axis=0)
            if shape.link >= self.n_links and not shape.radius
            else np.zeros((0, 3))
            for shape in self.shapes
        ]

    def of_pairs(self, pairs: Sequence[tuple[int, int]]) -> Obstacles:
        """Return the same robot and objects with other pairs.

        Args:
            pairs: Rows in ``names`` of a link or object, and of another object.
        """
        found = object.__new__(Obstacles)
        found.__dict__.update(self.__dict__, _distances=self._distances)
        found._use(pairs)
        return found

    def contacts_among(
        self,
        link_poses: np.ndarray,
        object_poses: np.ndarray,
        margin: float = 0.0,
        floor: float = -MAX_VALUE,
    ) -> Contacts:
        """Find what is nearer than a margin.

        Args:
            link_poses: Poses of all links in the map, in the order of the description,
                without a root that is the world, shape (n, n_links, 7).
            object_poses: Poses of the objects in the map, in the order of the scene,
                shape (n, n_objects, 7), or (n_objects, 7) if they do not move.
            margin: In [m]; 0: only overlaps.
            floor: Height of the floor in the map, in [m]; by default there is none.

        Returns:
            The contacts, with the rows of ``pairs``.

        Raises:
            InvalidValueError: If poses have another shape or are not finite.
        """
        count = len(link_poses)
        objects = np.broadcast_to(object_poses, (count, *object_poses.shape[-2:]))
        ground = np.tile([*floor * UP, *IDENTITY[3:]], (count, 1, 1))
        poses = np.concatenate([link_poses, objects, ground], axis=1)
        found = [self.contacts(poses, margin)]
        found += self._plane_contacts(poses, margin)
        joined = Contacts.joined(found)
        return joined[deepest(joined)]

    def _near_rows(self, poses: np.ndarray, rows: np.ndarray, gap: float) -> np.ndarray:
        """Leave out shapes of objects that are far from the whole robot throughout."""
        center, radius = self._bounds.spheres(poses)
        low = (center - radius[:, np.newaxis]).min(axis=0)
        high = (center + radius[:, np.newaxis]).max(axis=0)
        first, second = rows[:, 0], rows[:, 1]
        apart = np.maximum(low[first] - high[second], low[second] - high[first])
        return rows[apart.max(axis=1) < gap]

    def _plane_contacts(self, poses: np.ndarray, margin: float) -> Iterator[Contacts]:
        """Yield contacts with planes."""
        for number, shape, (plane, point, normal) in self._plane_pairs:
            of_plane, of_shape = poses[:, plane], poses[:, shape.link]
            normals = rotate(of_plane[:, 3:], normal)
            points = of_plane[:, :3] + rotate(of_plane[:, 3:], point)
            axes = axes_of(of_shape[:, 3:])
            along = turn(np.swapaxes(axes, 1, 2), normals) @ shape.points.T
            lowest = shape.points[along.argmin(axis=1)]
            nearest = of_shape[:, :3] + turn(axes, lowest) - shape.radius * normals
            distance = ((nearest - points) * normals).sum(axis=1)
            near = np.flatnonzero(distance < margin)
            size, normal_a, points_a = distance[near], -normals[near], nearest[near]
            points_b = points_a + size[:, np.newaxis] * normal_a
            pair = np.full(len(near), number)
            yield Contacts(near, pair, size, points_a, points_b, normal_a)


def _pairs(description: Description, scene: Scene) -> Iterator[tuple[int, int]]:
    """Yield the rows of links or carried objects, and of objects, that are checked."""
    links = [link.name for link in posed_links(description)]
    floor = len(links) + len(scene)
    body = bodies_of(description)
    above = {joint.child: body[joint.parent] for joint in description.joints}
    objects = list(scene.values())
    roles = description.profile.links
    touching = [{roles.get(n, n) for n in each.may_touch} for each in objects]
    for row, each in enumerate(objects, len(links)):
        own = touching[row - len(links)]
        carriers = [
            named_link(description, a.link, each.name) for a in each.attachments
        ]
        hands = {body[link] for link in carriers}
        hands |= {body[roles[n]] for n in each.may_touch if roles.get(n) in body}
        # A wrist cannot get away from what its hand holds.
        free = hands | {above[hand] for hand in hands if hand in above}
        free |= {body[name] for name in own if name in body}
        for number, link in enumerate(links):
            if body[link] not in free:
                yield number, row
        if each.attachments:
            for other, thing in enumerate(objects, len(links)):
                names = touching[other - len(links)]
                is_free = each.name in names or thing.name in own
                is_double = bool(thing.attachments) and other <= row
                if thing is not each and not is_free and not is_double:
                    yield row, other
            yield row, floor
