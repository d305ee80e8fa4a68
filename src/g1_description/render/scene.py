"""Rendering of robots: their visual shapes in a separate PyBullet client.

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
        return rgb, self._owners()[np.reshape(bodies, (rows, columns))]

    def _owners(self) -> np.ndarray:
        """Map PyBullet's ids of bodies to robots; the last row is for none."""
        pairs = [(p.body, n) for n, r in enumerate(self._robots) for p in r.pieces]
        owners = np.full(max((body for body, _ in pairs), default=0) + 2, NOTHING)
        for body, number in pairs:
            owners[body] = number
        return owners
