"""Pictures of robots: their visual shapes in a separate PyBullet client, on a floor.

Each shape is a static body, placed by our kinematics. PyBullet knows neither joints nor
masses, so links without mass are drawn, too.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from g1_description.render.camera import Camera, Crop, crop_around, matrices
from g1_description.render.patches import GREY
from g1_description.robot.assembly import Assembly
from g1_description.robot.description import Description, Shape
from g1_description.robot.kinematics import Kinematics
from g1_description.robot.transform import IDENTITY, compose
from g1_description.sim.bullet.client import BulletClient, connect, pybullet
from g1_description.sim.meshes.shapes import (
    Mesh,
    Part,
    find_meshes,
    is_there,
    scaled_parts,
)
from g1_description.sim.meshes.stl import ROUND

BATCH_SIZE = 40_000
"""Triangles per shape: PyBullet accepts 131072 corners."""


def load_visual(
    client: BulletClient, shape: Shape, mesh: Mesh | None
) -> tuple[list[int], str]:
    """Load a shape, with a bounding box that PyBullet updates.

    Args:
        client: PyBullet.
        shape: The shape.
        mesh: The mesh, if it is one. As in RViz, the mesh's materials take precedence
            over the colour of the shape.

    Returns:
        PyBullet's ids of its bodies, and a message if it cannot be read.
    """
    color = list(shape.color or GREY)
    kind = pybullet.GEOM_BOX if shape.kind == "box" else pybullet.GEOM_MESH
    looks = [(_primitive(shape), color)]
    if mesh is not None and (mesh.parts or min(shape.size) <= 0):
        looks = [
            (form, list(part.color or color))
            for part in by_color(scaled_parts(mesh, shape.size))
            for form in _triangles(part)
        ]
    elif mesh is not None:  # PyBullet mirrors neither the order of corners nor normals
        looks = [({"fileName": str(mesh.path), "meshScale": list(shape.size)}, color)]
    try:
        return [_body(client, kind, *look) for look in looks], ""
    except pybullet.error:
        return [], f"{shape.kind} {shape.filename} cannot be read"


def by_color(parts: Sequence[Part]) -> list[Part]:
    """Merge the parts of each colour."""
    return [
        Part(
            np.concatenate([part.corners for part in parts if part.color == color]),
            np.concatenate([part.normals for part in parts if part.color == color]),
            color,
        )
        for color in dict.fromkeys(part.color for part in parts)
    ]


def _body(
    client: BulletClient, kind: int, form: dict[str, object], color: list[float]
) -> int:
    """Create a body from PyBullet's arguments; return its id."""
    visual = client.createVisualShape(kind, **form, rgbaColor=color)
    solid = {name: value for name, value in form.items() if name != "normals"}
    box = client.createCollisionShape(kind, **solid)
    return int(client.createMultiBody(0.0, box, visual))


def _triangles(part: Part) -> Iterator[dict[str, object]]:
    """Convert a part to PyBullet's arguments, ``BATCH_SIZE`` triangles at a time."""
    for first in range(0, len(part.corners), BATCH_SIZE):
        some = slice(first, first + BATCH_SIZE)
        corners = part.corners[some].reshape(-1, 3)
        yield {
            "vertices": corners.tolist(),
            "normals": part.normals[some].reshape(-1, 3).tolist(),
            "indices": list(range(len(corners))),
        }


def _primitive(shape: Shape) -> dict[str, object]:
    """Convert a primitive to PyBullet's arguments; its own round shapes are coarse."""
    if shape.kind == "mesh":
        return {}
    if shape.kind == "box":
        return {"halfExtents": [size / 2 for size in shape.size]}
    surface = ROUND[shape.kind](*shape.size)
    return {
        "vertices": surface.vertices.tolist(),
        "normals": surface.normals.tolist(),
        "indices": surface.triangles.ravel().tolist(),
    }


AMBIENT, DIFFUSE, SPECULAR = 0.72, 0.55, 0.06
"""Coefficients of ambient, diffuse and specular light."""

NOTHING = -1
"""The number of a pixel without a robot."""

AIR = np.array([[0.99, 0.99, 0.995], [0.91, 0.925, 0.94]])
"""Colours of the top and the bottom of a picture, from 0 to 1."""

CELL = 0.25
"""Width of a cell of the grid, in [m]."""

LINE = 0.004
"""Width of a line of the grid, in [m]."""

LINES_DARKEN, SHADOW_DARKENS = 0.13, 0.42
"""Darkening of the floor by lines and shadows."""

SUPERSAMPLING = 3
"""Pixels drawn for one pixel of the picture, in each direction."""

LAMP = np.radians([-38.0, 50.0])
"""Direction of the lamp: yaw relative to the camera, and elevation, in [rad]."""

LAMP_PIXELS = 400
"""Size of the shadow map in pixels."""

SHADOW_BLUR = 2
"""Width of a shadow's edge, in pixels of the shadow map."""


@dataclass(frozen=True)
class _Piece:
    """A visual shape in the scene."""

    link: str
    pose: np.ndarray
    """In the frame of its link, shape (7,)."""

    body: int
    """PyBullet's id of it."""


@dataclass(frozen=True)
class _Robot:
    """The shapes and kinematics of one robot."""

    joints: tuple[str, ...]
    links: tuple[str, ...]
    kinematics: Kinematics
    pieces: tuple[_Piece, ...]


class Scene:
    """Robots in the world; must be closed, or used in a ``with`` statement."""

    def __init__(self) -> None:
        self._client = connect()
        self._robots: list[_Robot] = []

    def __enter__(self) -> Scene:
        """Enter a ``with`` statement."""
        return self

    def __exit__(self, *_: object) -> None:
        """Close the scene."""
        self.close()

    def close(self) -> None:
        """Disconnect from PyBullet."""
        self._client.disconnect()

    def add(self, description: Description) -> tuple[int, tuple[str, ...]]:
        """Add a robot, its root at the origin and its joints at zero.

        Args:
            description: The robot; fixed links may be lumped.

        Returns:
            The robot's number, from 0, and messages on what of it cannot be used.
        """
        pieces, refused = [], []
        shapes = [
            (link.name, shape) for link in description.links for shape in link.visuals
        ]
        meshes, left_out = find_meshes(shape for _, shape in shapes)
        for link, shape in shapes:
            if is_there(shape, meshes):
                mesh = meshes.get(shape.filename)
                bodies, why_not = load_visual(self._client, shape, mesh)
                pieces += [_Piece(link, shape.pose, body) for body in bodies]
                refused += [why_not] if why_not else []
        self._robots.append(
            _Robot(
                tuple(joint.name for joint in description.movable_joints),
                Assembly(description).link_names,
                Kinematics(description),
                tuple(pieces),
            )
        )
        number = len(self._robots) - 1
        self.place(number, IDENTITY, {})
        return number, (*description.unread, *left_out, *dict.fromkeys(refused))

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
        for piece in figure.pieces:
            pose = compose(by_link.get(piece.link, T_world_root), piece.pose)
            self._client.resetBasePositionAndOrientation(piece.body, pose[:3], pose[3:])

    def corners(self) -> np.ndarray:
        """Return the corners of the axis-aligned bounding boxes of all shapes.

        Returns:
            Points in the world, in [m], shape (8 n_shapes, 3).
        """
        bodies = [piece.body for robot in self._robots for piece in robot.pieces]
        boxes = np.array([self._client.getAABB(body) for body in bodies])
        boxes = boxes.reshape(-1, 2, 3)
        choices = np.indices((2, 2, 2)).reshape(3, 8).T
        return boxes[:, choices, np.arange(3)].reshape(-1, 3)

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
        rows, columns = (part.stop - part.start for part in crop)
        if not rows or not columns:
            return np.zeros((rows, columns, 3), np.uint8), np.zeros(
                (rows, columns), int
            )
        _, _, rgba, _, bodies = self._client.getCameraImage(
            columns,
            rows,
            *matrices(camera, width, height, crop),
            lightDirection=list(camera.axes[2] if light is None else light),
            lightAmbientCoeff=AMBIENT,
            lightDiffuseCoeff=DIFFUSE,
            lightSpecularCoeff=SPECULAR,
            shadow=0,
            renderer=self._client.ER_TINY_RENDERER,
        )
        rgb = np.reshape(rgba, (rows, columns, 4))[:, :, :3].astype(np.uint8)
        pairs = [(p.body, n) for n, r in enumerate(self._robots) for p in r.pieces]
        # Robots by PyBullet's ids of bodies; the last row is for none.
        owners = np.full(max((body for body, _ in pairs), default=0) + 2, NOTHING)
        for body, number in pairs:
            owners[body] = number
        return rgb, owners[np.reshape(bodies, (rows, columns))]


def backdrop(
    camera: Camera,
    width: int,
    height: int,
    floor: float,
    shadow: tuple[Camera, np.ndarray],
) -> np.ndarray:
    """Draw the background and the floor.

    Args:
        camera: The camera.
        width: Width of the picture, in pixels.
        height: Height of the picture, in pixels.
        floor: Height of the floor in the world, in [m].
        shadow: Camera at the lamp, and the blocked fraction of its light in each of its
            pixels, from 0 to 1, shape (n, m).

    Returns:
        Colours from 0 to 1, shape (height, width, 3).
    """
    blend = np.linspace(0.0, 1.0, height)[:, np.newaxis, np.newaxis]
    air = AIR[0] + (AIR[1] - AIR[0]) * blend + np.zeros((1, width, 1))
    eye, rays = camera.rays(width, height)
    with np.errstate(divide="ignore", invalid="ignore"):
        way = (floor - eye[2]) / rays[..., 2]
        is_floor = (way > 0.0) & (way < 20.0)
    points = eye + np.where(is_floor, way, 1.0)[..., np.newaxis] * rays
    darker = LINES_DARKEN * _grid(points, is_floor)
    darker = 1.0 - (1.0 - darker) * (1.0 - SHADOW_DARKENS * _shadow_at(points, *shadow))
    across = np.linalg.norm(points[..., :2] - camera.target[:2], axis=-1)
    fade = np.where(is_floor, np.exp(-((across / camera.width) ** 2)), 0.0)
    return air * (1.0 - fade * darker)[..., np.newaxis]


def _grid(points: np.ndarray, is_floor: np.ndarray) -> np.ndarray:
    """Compute the fraction of each pixel that grid lines cover."""
    clear = np.ones(points.shape[:2])
    for axis in (0, 1):
        values = points[..., axis]
        pixel = np.hypot(*np.gradient(values)) + 1e-9
        off = np.abs(values - CELL * np.round(values / CELL))
        line = np.maximum(LINE, pixel)
        covered = np.clip(0.5 + (line / 2 - off) / pixel, 0.0, 1.0) * LINE / line
        clear *= 1.0 - np.where(pixel < CELL / 2, covered, 0.0)
    return np.where(is_floor, 1.0 - clear, 0.0)


def _shadow_at(points: np.ndarray, lamp: Camera, shadow_mask: np.ndarray) -> np.ndarray:
    """Compute the fraction of the lamp's light that robots block.

    Args:
        points: In the world, in [m], shape (height, width, 3).
        lamp: Camera at the lamp.
        shadow_mask: Blocked fraction in each of its pixels, shape (n, m).
    """
    n, m = shadow_mask.shape
    seen = lamp.seen(points.reshape(-1, 3)) * m
    column, row = seen[:, 0] + m / 2 - 0.5, n / 2 - 0.5 - seen[:, 1]
    inside = (column >= 0) & (column < m - 1) & (row >= 0) & (row < n - 1)
    column, row = np.where(inside, column, 0.0), np.where(inside, row, 0.0)
    i, j = row.astype(int), column.astype(int)
    down, right = row - i, column - j
    top = shadow_mask[i, j] * (1 - right) + shadow_mask[i, j + 1] * right
    bottom = shadow_mask[i + 1, j] * (1 - right) + shadow_mask[i + 1, j + 1] * right
    fractions = np.where(inside, top * (1 - down) + bottom * down, 0.0)
    return fractions.reshape(points.shape[:2])


def blur(fractions: np.ndarray, reach: int) -> np.ndarray:
    """Blur a picture with a box filter, three times.

    Args:
        fractions: Shape (n, m).
        reach: Half of the square's side, in pixels.

    Returns:
        Shape (n, m); pixels outside count as 0.
    """
    side = 2 * reach + 1
    for _ in range(3):
        for _ in ("down", "across"):
            sums = np.cumsum(np.pad(fractions, ((reach + 1, reach), (0, 0))), axis=0)
            fractions = ((sums[side:] - sums[:-side]) / side).T
    return fractions


def draw(
    scene: Scene, camera: Camera, width: int, height: int, floor: float = 0.0
) -> np.ndarray:
    """Draw a scene on a floor.

    The floor does not hide things below it.

    Args:
        scene: The robots.
        camera: The camera.
        width: Width of the picture, in pixels.
        height: Height of the picture, in pixels.
        floor: Its height in the world, in [m].

    Returns:
        Colours as uint8, shape (height, width, 3).
    """
    # The lamp next to the camera sees everything that the camera sees.
    reach = 1.5 * camera.width * max(1.0, height / width)
    lamp = Camera(camera.target, camera.yaw + LAMP[0], LAMP[1], reach)
    is_seen = silhouette(scene, lamp, LAMP_PIXELS, LAMP_PIXELS) != NOTHING
    shadow = lamp, blur(is_seen.astype(float), SHADOW_BLUR)
    behind = 255.0 * backdrop(camera, width, height, floor, shadow)
    crop = scene.crop(camera, width, height)
    rows, columns = (
        slice(SUPERSAMPLING * part.start, SUPERSAMPLING * part.stop) for part in crop
    )
    colors, robots = scene.render(
        camera,
        SUPERSAMPLING * width,
        SUPERSAMPLING * height,
        (rows, columns),
        lamp.axes[2],
    )
    seen = (robots != NOTHING)[..., np.newaxis]
    clear = 1.0 - _downsampled(seen)
    behind[crop] = behind[crop] * clear + _downsampled(colors * seen)
    return np.clip(np.round(behind), 0, 255).astype(np.uint8)


def silhouette(scene: Scene, camera: Camera, width: int, height: int) -> np.ndarray:
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
    height, width, parts = pixels.shape
    fine = pixels.reshape(
        height // SUPERSAMPLING,
        SUPERSAMPLING,
        width // SUPERSAMPLING,
        SUPERSAMPLING,
        parts,
    )
    return fine.mean(axis=(1, 3), dtype=np.float32)
