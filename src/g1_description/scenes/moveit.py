"""Objects from MoveIt's messages, and for its files of scenes."""

from __future__ import annotations

import hashlib
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import zip_longest
from typing import Any, Dict

import numpy as np

from g1_description.errors import InvalidValueError, UnknownNameError
from g1_description.files.atomic import write_whole
from g1_description.files.model_files import ros_home
from g1_description.robot.assembly import MAP, WORLD
from g1_description.robot.description import Link, Shape
from g1_description.robot.transform import IDENTITY, compose, inverse
from g1_description.scenes.objects import (
    COLOR,
    SceneObject,
    attached,
    direction,
    numbers,
    sizes,
    with_mass,
)
from g1_description.sim.meshes.shapes import Mesh, find_meshes, is_there, scaled_parts
from g1_description.sim.meshes.stl import write_stl
from g1_description.text import listed

ADD, REMOVE, APPEND, MOVE = range(4)
"""Operations of a moveit_msgs/CollisionObject."""

PRIMITIVES = {1: ("box", 3), 2: ("sphere", 1), 3: ("cylinder", 2)}
"""Kinds of a shape_msgs/SolidPrimitive, with the numbers of their sizes; a cylinder has
its height first, a cone is not supported."""

WORLDS = ("", MAP, WORLD, f"/{MAP}", f"/{WORLD}")
"""Frames that are the map."""


Objects = Dict[str, SceneObject]


def apply_message(
    objects: Objects, message: Any, frames: Mapping[str, np.ndarray]
) -> None:
    """Change objects by name as a message of MoveIt says; see ``Scene.apply``."""
    if hasattr(message, "world"):  # a PlanningScene
        if not message.is_diff:
            objects.clear()
        for each in message.robot_state.attached_collision_objects:
            _attach(objects, each, frames)
        for each in message.world.collision_objects:
            _apply(objects, each, frames)
        for one in message.object_colors:
            if one.id in objects:
                objects[one.id] = _colored(objects[one.id], one.color)
    elif hasattr(message, "touch_links"):  # an AttachedCollisionObject
        _attach(objects, message, frames)
    elif hasattr(message, "primitive_poses"):  # a CollisionObject
        _apply(objects, message, frames)
    else:
        raise InvalidValueError(
            "A scene takes a PlanningScene, CollisionObject or AttachedCollisionObject "
            f"of moveit_msgs (got {type(message).__name__})."
        )


def frames_of(message: Any, objects: Objects) -> set[str]:
    """List the frames that a message needs, but for the map.

    Args:
        message: As for ``Scene.apply``.
        objects: The objects before it.
    """
    if hasattr(message, "world"):
        held = message.robot_state.attached_collision_objects
        free = message.world.collision_objects
    else:
        held = [message] if hasattr(message, "touch_links") else []
        free = [] if held else [message]
    bodies = [*free, *(each.object for each in held)]
    names = {body.header.frame_id for body in bodies if body.operation != REMOVE}
    for each in held:
        if each.object.operation == REMOVE:
            names |= {a.link for _, o in _let_go(objects, each) for a in o.attachments}
        else:
            names.add(each.link_name)
    return names - {*WORLDS}


def _let_go(objects: Objects, message: Any) -> list[tuple[str, SceneObject]]:
    """List the objects that a message detaches."""
    return [
        (name, each)
        for name, each in objects.items()
        if message.object.id in ("", name)
        and message.link_name in ("", *(one.link for one in each.attachments))
    ]


def _apply(objects: Objects, message: Any, frames: Mapping[str, np.ndarray]) -> None:
    """Change one object."""
    name, operation = message.id, message.operation
    if operation == REMOVE:
        for each in [name] if name else [*objects]:
            if each in objects and not objects[each].attachments:
                del objects[each]
        return
    poses = [*message.primitive_poses, *message.mesh_poses]
    own = _pose(getattr(message, "pose", None))
    # As in MoveIt, the pose of a single shape is that of its object if that has none.
    is_of_shape = len(poses) == 1 and np.array_equal(own, IDENTITY)
    own = _pose(poses[0]) if is_of_shape else own
    pose = compose(_frame(message, frames), own)
    if operation == MOVE:
        if name not in objects:
            raise UnknownNameError(f"There is no object '{name}' to move.")
        objects[name] = replace(objects[name], pose=pose)
        return
    shapes = tuple(_shapes(message))
    if not shapes:
        raise InvalidValueError(f"The object {name} has no shapes.")
    if is_of_shape:
        shapes = (replace(shapes[0], pose=IDENTITY), *shapes[1:])
    if operation == APPEND and name in objects:
        old = objects[name]
        shift = compose(inverse(old.pose), pose)
        shapes = tuple(replace(s, pose=compose(shift, s.pose)) for s in shapes)
        shapes, pose = (*old.link.collisions, *shapes), old.pose
    objects[name] = SceneObject(Link(name, None, shapes, shapes), pose)


def _attach(objects: Objects, message: Any, frames: Mapping[str, np.ndarray]) -> None:
    """Attach an object to a link, or let it go."""
    body, link = message.object, message.link_name
    if body.operation == REMOVE:
        for name, each in _let_go(objects, message):
            pose = each.pose
            for one in each.attachments:
                if one.grip is not None:
                    place = _known_frame(name, one.link, frames)
                    pose = compose(place, np.array(one.grip))
            objects[name] = replace(each, pose=pose, attachments=())
        return
    if body.primitives or body.meshes or body.planes or body.id not in objects:
        _apply(objects, body, frames)
    free = replace(objects[body.id], attachments=())
    touching = free.may_touch | {*message.touch_links}
    if message.weight > 0.0:
        free = with_mass(free, message.weight)
    carried = attached(free, link, -np.inf, np.inf)
    if link in frames:
        grip = compose(inverse(frames[link]), carried.pose)
        one = replace(carried.attachments[0], grip=tuple(grip.tolist()))
        carried = replace(carried, attachments=(one,))
    objects[body.id] = replace(carried, may_touch=touching)


def _frame(message: Any, frames: Mapping[str, np.ndarray]) -> np.ndarray:
    """Find the frame of an object in the map."""
    name = message.header.frame_id
    if name in WORLDS and name not in frames:
        return IDENTITY
    return _known_frame(message.id, name, frames)


def _known_frame(owner: str, name: str, frames: Mapping[str, np.ndarray]) -> np.ndarray:
    """Return the pose of a frame in the map."""
    if name not in frames:
        raise InvalidValueError(
            f"The object {owner} is in the frame {name}, which is not known. Give "
            "its pose in the map as frames, such as robot.link_poses(positions, base)."
        )
    return frames[name]


def _pose(message: Any) -> np.ndarray:
    """Read a pose; one of zeros, or none at all, is the identity."""
    if message is None:
        return IDENTITY
    place, turn = message.position, message.orientation
    q = np.array([turn.x, turn.y, turn.z, turn.w])
    length = np.linalg.norm(q)
    q = q / length if length > 0.0 else IDENTITY[3:]
    return np.concatenate([[place.x, place.y, place.z], q])


def _shapes(message: Any) -> Iterator[Shape]:
    """Read the shapes of an object, in its frame."""
    name = message.id
    for primitive, pose in _posed(message.primitives, message.primitive_poses):
        if primitive.type not in PRIMITIVES:
            raise InvalidValueError(
                f"The object {name} has a shape of type {primitive.type}, which is not "
                f"one of {listed(kind for kind, _ in PRIMITIVES.values())}."
            )
        kind, count = PRIMITIVES[primitive.type]
        size = sizes(name, "size", list(primitive.dimensions), count)
        size = size[::-1] if kind == "cylinder" else size
        yield Shape(kind, size, _pose(pose), name=kind, color=COLOR)
    for mesh, pose in _posed(message.meshes, message.mesh_poses):
        uri = _kept_mesh(name, mesh)
        yield Shape("mesh", (1.0, 1.0, 1.0), _pose(pose), uri, "mesh", color=COLOR)
    for plane, pose in _posed(message.planes, message.plane_poses):
        *normal, offset = numbers(name, "plane", list(plane.coef), 4)
        unit = direction(name, normal)
        nearest = -offset / np.linalg.norm(normal) * unit
        point = np.concatenate([nearest, IDENTITY[3:]])
        at = compose(_pose(pose), point)
        yield Shape("plane", tuple(unit.tolist()), at, name="plane", color=COLOR)


def _posed(shapes: Sequence[Any], poses: Sequence[Any]) -> Iterator[tuple[Any, Any]]:
    """Yield shapes with their poses; None where there is none."""
    return zip_longest(shapes, poses[: len(shapes)])


def _kept_mesh(name: str, mesh: Any) -> str:
    """Keep the triangles of a message in a file, and return its URI."""
    vertices = np.array([[v.x, v.y, v.z] for v in mesh.vertices]).reshape(-1, 3)
    rows = [list(each.vertex_indices) for each in mesh.triangles]
    faces = np.array(rows, dtype=int).reshape(-1, 3)
    if not len(faces) or faces.max() >= len(vertices) or faces.min() < 0:
        raise InvalidValueError(f"The mesh of the object {name} has no triangles.")
    data = write_stl(vertices[faces])
    known = hashlib.sha256(data).hexdigest()[:16]
    file = ros_home() / "g1_description" / "meshes" / f"{known}.stl"
    if not file.exists():
        write_whole(file, data)
    return file.as_uri()


def _colored(each: SceneObject, color: Any) -> SceneObject:
    """Give an object a colour."""
    rgba = (color.r, color.g, color.b, color.a)
    shapes = tuple(replace(shape, color=rgba) for shape in each.link.visuals)
    return replace(each, link=replace(each.link, visuals=shapes))


def scene_text(objects: Collection[SceneObject]) -> str:
    """Write the text of a file of MoveIt, for moveit_publish_scene_from_text and RViz.

    Attachments are left out: MoveIt has them in the state of the robot.
    """
    meshes, _ = find_meshes(s for each in objects for s in each.link.collisions)
    lines = ["scene"]
    for each in objects:
        shapes = [one for one in each.link.collisions if is_there(one, meshes)]
        lines += [f"* {each.name}", *_pose_lines(each.pose), str(len(shapes))]
        for shape in shapes:
            color = next((one.color for one in each.link.visuals if one.color), COLOR)
            lines += _shape_lines(shape, meshes.get(shape.filename))
            lines += [*_pose_lines(shape.pose), _row(color)]
        lines.append("0")  # subframes
    return "\n".join([*lines, ".", ""])


def _row(values: Any) -> str:
    return " ".join(f"{float(value):.9g}" for value in values)


def _pose_lines(pose: np.ndarray) -> list[str]:
    return [_row(pose[:3]), _row(pose[3:])]


def _shape_lines(shape: Shape, mesh: Mesh | None) -> list[str]:
    """Write kind and size of a shape; MoveIt has no capsules."""
    if mesh is not None:
        parts = scaled_parts(mesh, shape.size)
        corners = np.concatenate([part.corners for part in parts]).reshape(-1, 3)
        vertices, faces = np.unique(corners, axis=0, return_inverse=True)
        rows = [_row(vertex) for vertex in vertices]
        rows += [" ".join(map(str, face)) for face in faces.reshape(-1, 3).tolist()]
        return ["mesh", f"{len(vertices)} {len(faces) // 3}", *rows]
    if shape.kind == "capsule":
        radius, length = shape.size
        return ["cylinder", _row([radius, length + 2.0 * radius])]
    size = [*shape.size, 0.0] if shape.kind == "plane" else shape.size
    return [shape.kind, _row(size)]
