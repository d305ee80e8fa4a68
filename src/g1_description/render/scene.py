"""Pictures of robots and objects: their visual shapes, placed, on a floor."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from g1_description.render.backdrop import backdrop, blur
from g1_description.render.camera import NEAREST, Camera, Crop, crop_around
from g1_description.render.patches import GREY, object_shapes, shape_parts
from g1_description.render.rasterizer import NOTHING, nearest, touching, weights
from g1_description.robot.assembly import Assembly
from g1_description.robot.description import Description, Shape
from g1_description.robot.kinematics import Kinematics
from g1_description.robot.rotation import rotate, to_axes
from g1_description.robot.transform import IDENTITY
from g1_description.scenes.objects import SceneObject
from g1_description.sim.meshes.shapes import find_meshes, is_there

AMBIENT, DIFFUSE = 0.75, 0.55
"""Coefficients of ambient and diffuse light."""

SUPERSAMPLING = 3
"""Pixels drawn for one pixel of the picture, in each direction."""

LAMP = np.radians([-38.0, 50.0])
"""Direction of the lamp: yaw relative to the camera, and elevation, in [rad]."""

LAMP_PIXELS = 400
"""Size of the shadow map in pixels."""

SHADOW_BLUR = 2
"""Width of a shadow's edge, in pixels of the shadow map."""

NEAR = 0.6
"""Distance from the robots in which a camera should see objects, in [m]."""

TINY = 1e-300
"""Avoids division by zero."""


class _Robot(NamedTuple):
    """The kinematics of one robot."""

    joints: tuple[str, ...]
    links: tuple[str, ...]
    kinematics: Kinematics


class _Piece(NamedTuple):
    """Triangles of one colour that move with a link or an object."""

    robot: int
    """Number of its robot, or of a group of objects."""

    link: str
    corners: np.ndarray
    """x, y, z (axis 0) of corners (axis 1) in the link's frame, shape (3, 3, n)."""

    box: np.ndarray
    """Corners of the box around them, along the axes of the link, shape (8, 3)."""

    color: tuple[float, ...]


class Picture:
    """Robots and objects in the world."""

    def __init__(self) -> None:
        self._robots: dict[int, _Robot] = {}
        self._poses: list[dict[str, np.ndarray]] = []
        self._pieces: list[_Piece] = []
        self._normals = np.zeros((0, 3, 3))
        self._piece_of = np.zeros(0, int)

    def add(self, description: Description) -> tuple[int, tuple[str, ...]]:
        """Add a robot, its root at the origin and its joints at zero.

        Args:
            description: The robot; fixed links may be lumped.

        Returns:
            The robot's number, from 0, and messages on what of it cannot be used.
        """
        number = len(self._poses)
        left_out = self._add(
            number, {link.name: link.visuals for link in description.links}
        )
        self._robots[number] = _Robot(
            tuple(joint.name for joint in description.movable_joints),
            Assembly(description).link_names,
            Kinematics(description),
        )
        self.place(number, IDENTITY, {})
        return number, (*description.unread, *left_out)

    def add_objects(
        self, objects: Collection[SceneObject]
    ) -> tuple[int, tuple[str, ...]]:
        """Add objects at their first places.

        Planes have no end, and are left out.

        Args:
            objects: The objects.

        Returns:
            The number of the group, and messages on what of it cannot be used.
        """
        number, shapes = len(self._poses), object_shapes(objects)
        left_out = self._add(
            number,
            {
                name: [shape for shape in some if shape.kind != "plane"]
                for name, some in shapes.items()
            },
        )
        self._poses[number].update({each.name: each.pose for each in objects})
        return number, left_out

    def move(self, group: int, poses: Mapping[str, np.ndarray]) -> None:
        """Place objects of a group: T_world_object, shape (7,), by name."""
        self._poses[group].update(poses)

    def _add(
        self, number: int, shapes: Mapping[str, Sequence[Shape]]
    ) -> tuple[str, ...]:
        """Add shapes by the name of what they move with; return what is left out."""
        meshes, left_out = find_meshes(s for some in shapes.values() for s in some)
        normals, counts = [self._normals], []
        for link, shape in ((link, s) for link, some in shapes.items() for s in some):
            if not is_there(shape, meshes):
                continue
            for part in shape_parts(shape, meshes.get(shape.filename)):
                self._add_piece(number, link, part.corners, part.color or GREY)
                normals.append(part.normals)
                counts.append(len(part.normals))
        new = np.arange(len(self._pieces) - len(counts), len(self._pieces))
        self._normals = np.concatenate(normals)
        self._piece_of = np.concatenate([self._piece_of, np.repeat(new, counts)])
        self._poses.append({})
        return left_out

    def _add_piece(
        self, number: int, link: str, triangles: np.ndarray, color: tuple[float, ...]
    ) -> None:
        """Add triangles with corners of shape (n, 3, 3), but not their normals."""
        corners = np.ascontiguousarray(triangles.T)
        box = np.array([corners.min(axis=(1, 2)), corners.max(axis=(1, 2))])
        choices = np.indices((2, 2, 2)).reshape(3, 8).T
        box = box[choices, np.arange(3)]
        self._pieces.append(_Piece(number, link, corners, box, color))

    def add_triangles(self, corners: np.ndarray, color: tuple[float, ...]) -> None:
        """Add triangles with corners in the world, in [m], shape (3 n, 3)."""
        triangles = corners.reshape(-1, 3, 3)
        sides = triangles[:, 1:] - triangles[:, :1]
        normals = np.cross(sides[:, 0], sides[:, 1])[:, np.newaxis]
        self._normals = np.concatenate([self._normals, np.repeat(normals, 3, axis=1)])
        new = np.full(len(triangles), len(self._pieces))
        self._piece_of = np.concatenate([self._piece_of, new])
        self._add_piece(len(self._poses), "", triangles, color)
        self._poses.append({"": IDENTITY})

    def place(
        self, robot: int, T_world_root: np.ndarray, positions: Mapping[str, float]
    ) -> None:
        """Place a robot.

        Args:
            robot: The robot's number.
            T_world_root: Pose of its root link in the world, shape (7,).
            positions: Positions in [rad] or [m] by joint; missing ones are 0.
        """
        figure = self._robots[robot]
        position = np.array([positions.get(name, 0.0) for name in figure.joints])
        poses = figure.kinematics.link_poses(T_world_root, position)
        by_link = dict(zip(figure.links, poses))
        self._poses[robot] = {
            piece.link: by_link.get(piece.link, T_world_root)
            for piece in self._pieces
            if piece.robot == robot
        }

    def corners(self) -> np.ndarray:
        """Return the corners of the boxes around all shapes, along their links' axes.

        Returns:
            Points in the world, in [m], shape (8 n_shapes, 3).
        """
        return self._corners(self._pieces)

    def subject(self) -> np.ndarray:
        """Return corners that a camera should see: of robots, and of what is near.

        Returns:
            Points as of ``corners``; those of objects are limited to ``NEAR`` around
            the robots.
        """
        robots = self._corners([p for p in self._pieces if p.robot in self._robots])
        if not len(robots):
            return self.corners()
        found = [robots]
        low, high = robots.min(axis=0) - NEAR, robots.max(axis=0) + NEAR
        for piece in (p for p in self._pieces if p.robot not in self._robots):
            points = self._corners([piece])
            ends = points.min(axis=0), points.max(axis=0)
            if (ends[0] < high).all() and (ends[1] > low).all():
                found.append(np.clip(points, low, high))
        return np.concatenate(found)

    def _corners(self, pieces: Iterable[_Piece]) -> np.ndarray:
        """Return the corners of boxes in the world, shape (8 n, 3)."""
        found = [np.zeros((0, 3))]
        for piece in pieces:
            pose = self._poses[piece.robot][piece.link]
            found.append(pose[:3] + rotate(pose[3:], piece.box))
        return np.concatenate(found)

    def crop(self, camera: Camera, width: int, height: int) -> Crop:
        """Find the part of a picture, in pixels, that contains the robots."""
        return crop_around(self.corners(), camera, width, height)

    def render(
        self,
        camera: Camera,
        width: int,
        height: int,
        crop: Crop,
        light: np.ndarray | None = None,
    ) -> tuple[np.ndarray, np.ndarray]:
        """Render the robots, without background and antialiasing.

        Args:
            camera: The camera.
            width: Width of the whole picture, in pixels.
            height: Height of the picture, in pixels.
            crop: Part of the picture to render, n times m pixels.
            light: Direction to the lamp in the world, shape (3,); None: that to the
                camera.

        Returns:
            Colours as uint8, shape (n, m, 3), and numbers of robots, ``NOTHING`` for
            none, shape (n, m).
        """
        shape = tuple(part.stop - part.start for part in crop)
        colors, robots = np.zeros((*shape, 3), np.uint8), np.full(shape, NOTHING)
        if not self._pieces:
            return colors, robots
        corners, kept = self._projected(camera, width, height, crop)
        triangles = nearest(corners, *shape)
        row, column = np.nonzero(triangles != NOTHING)
        seen = triangles[row, column]
        piece = self._piece_of[kept[seen]]
        robots[row, column] = np.array([p.robot for p in self._pieces])[piece]
        poses = np.array([self._poses[p.robot][p.link] for p in self._pieces])
        lamp = camera.axes[2] if light is None else light
        lamps = lamp @ to_axes(poses[:, 3:])  # in the frames of links
        at = weights(corners[:, :, seen], row, column)
        normals = np.einsum("cn,nck->nk", at, self._normals[kept[seen]])
        lengths = np.sqrt(np.einsum("nk,nk->n", normals, normals))
        bright = np.einsum("nk,nk->n", normals, lamps[piece])
        bright = np.maximum(bright / np.maximum(lengths, TINY), 0.0)
        own = 255.0 * np.array([p.color[:3] for p in self._pieces])[piece]
        colors[row, column] = np.minimum(own.T * (AMBIENT + DIFFUSE * bright), 255.0).T
        return colors, robots

    def _projected(
        self, camera: Camera, width: int, height: int, crop: Crop
    ) -> tuple[np.ndarray, np.ndarray]:
        """Project the triangles in front of the eye to a part of a picture.

        Returns:
            The corners of those in it as ``nearest`` has them, and their numbers.
        """
        rows, columns = crop
        found, numbers, first = [], [], 0
        for piece in self._pieces:
            pose = self._poses[piece.robot][piece.link]
            axes = camera.axes @ to_axes(pose[3:])
            middle = camera.axes @ (pose[:3] - camera.target)
            points = axes @ piece.corners.reshape(3, -1) + middle[:, np.newaxis]
            right, up, back = points.reshape(piece.corners.shape)
            away = np.maximum(camera.range - back, NEAREST * camera.range)
            scale = camera.range * width / camera.width / away
            column = right * scale + (width / 2 - 0.5 - columns.start)
            row = height / 2 - 0.5 - rows.start - up * scale
            corners = np.stack([column, row, 1.0 / away])
            inside = touching(
                corners, rows.stop - rows.start, columns.stop - columns.start
            )
            is_in_front = (away > NEAREST * camera.range).all(axis=0)
            inside = inside[is_in_front[inside]]
            found.append(corners[:, :, inside])
            numbers.append(first + inside)
            first += piece.corners.shape[2]
        return np.concatenate(found, axis=2), np.concatenate(numbers)


def draw(
    scene: Picture,
    camera: Camera,
    width: int,
    height: int,
    floor: float = 0.0,
    on_top: Picture | None = None,
) -> np.ndarray:
    """Draw a scene on a floor.

    The floor does not hide things below it.

    Args:
        scene: The robots.
        camera: The camera.
        width: Width of the picture, in pixels.
        height: Height of the picture, in pixels.
        floor: Its height in the world, in [m].
        on_top: What is drawn over the robots, without a shadow; None: nothing.

    Returns:
        Colours as uint8, shape (height, width, 3).
    """
    # The lamp next to the camera sees everything that the camera sees.
    reach = 1.5 * camera.width * max(1.0, height / width)
    lamp = Camera(camera.target, camera.yaw + LAMP[0], LAMP[1], reach)
    is_seen = silhouette(scene, lamp, LAMP_PIXELS, LAMP_PIXELS) != NOTHING
    shadow = lamp, blur(is_seen.astype(float), SHADOW_BLUR)
    pixels = 255.0 * backdrop(camera, width, height, floor, shadow)
    for one in (scene,) if on_top is None else (scene, on_top):
        _paint(pixels, one, camera, lamp.axes[2])
    return np.clip(np.round(pixels), 0, 255).astype(np.uint8)


def _paint(
    pixels: np.ndarray, scene: Picture, camera: Camera, light: np.ndarray
) -> None:
    """Draw a scene over the pixels of a picture, shape (height, width, 3)."""
    height, width = pixels.shape[:2]
    crop = scene.crop(camera, width, height)
    rows, columns = (
        slice(SUPERSAMPLING * part.start, SUPERSAMPLING * part.stop) for part in crop
    )
    size = SUPERSAMPLING * width, SUPERSAMPLING * height
    colors, robots = scene.render(camera, *size, (rows, columns), light)
    seen = (robots != NOTHING)[..., np.newaxis]
    pixels[crop] = pixels[crop] * (1.0 - _downsampled(seen)) + _downsampled(colors)


def silhouette(scene: Picture, camera: Camera, width: int, height: int) -> np.ndarray:
    """Find the pixels that show a robot.

    Args:
        scene: The robots.
        camera: The camera.
        width: Width of the picture, in pixels.
        height: Height of the picture, in pixels.

    Returns:
        Numbers of robots, ``NOTHING`` for none, shape (height, width).
    """
    crop = scene.crop(camera, width, height)
    robots = np.full((height, width), NOTHING)
    robots[crop] = scene.render(camera, width, height, crop)[1]
    return robots


def _downsampled(pixels: np.ndarray) -> np.ndarray:
    """Return the mean of the rendered pixels that become one."""
    n = SUPERSAMPLING
    rows = np.mean([pixels[k::n] for k in range(n)], axis=0, dtype=np.float32)
    return np.mean([rows[:, k::n] for k in range(n)], axis=0)
