"""Objects around a robot: their shapes, where they are, and which links carry them."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from os import PathLike, fspath
from pathlib import Path
from typing import Any

import numpy as np

from g1_description.bounds import MAX_VALUE
from g1_description.errors import InvalidValueError
from g1_description.files.model_files import find_folder
from g1_description.files.uris import local_path
from g1_description.robot.arrays import one_pose
from g1_description.robot.assembly import SCOPE
from g1_description.robot.description import Inertial, Link, Shape
from g1_description.robot.rotation import from_rpy, to_axes
from g1_description.robot.transform import IDENTITY
from g1_description.sim.meshes.hulls import outline
from g1_description.sim.meshes.shapes import find_meshes
from g1_description.sim.model import Model
from g1_description.text import listed

COLOR = (0.76, 0.6, 0.42, 1.0)
"""Colour of objects without one: that of wood."""

INERTIAS: Mapping[str, Callable[..., Any]] = {
    "box": lambda x, y, z: [
        (y * y + z * z) / 12,
        (x * x + z * z) / 12,
        (x * x + y * y) / 12,
    ],
    "sphere": lambda r: 3 * [0.4 * r * r],
    "cylinder": lambda r, h: [*2 * [(3 * r * r + h * h) / 12], r * r / 2],
}
"""Moments of inertia of solid shapes of 1 kg about their axes, in [m^2]."""


@dataclass(frozen=True)
class Attachment:
    """A time in which a link carries an object."""

    link: str
    """Name of the link, or of a role in the robot's profile such as left_hand."""

    begin: float = -np.inf
    """When the link takes it, in [s]: it stays in the link's frame as it is then."""

    end: float = np.inf
    """When it is let go where it is then, in [s]."""

    grip: tuple[float, ...] | None = field(default=None, compare=False)
    """T_link_object when MoveIt attached it, if the link's place was known."""


@dataclass(frozen=True, eq=False)
class SceneObject:
    """An object: a rigid body that is no part of a robot."""

    link: Link
    """Its shapes, and its mass if it has one; its name is that of the object."""

    pose: np.ndarray
    """T_map_object at the start, shape (7,)."""

    attachments: tuple[Attachment, ...] = ()
    """In the order of time, without overlap."""

    may_touch: frozenset[str] = frozenset()
    """Links, roles and objects that may touch it, besides the link that carries it."""

    @property
    def name(self) -> str:
        """Its name."""
        return self.link.name

    @property
    def mass(self) -> float | None:
        """In [kg]; None: it is not known, and the object is static in a simulation."""
        return self.link.inertial.mass if self.link.inertial else None

    def __repr__(self) -> str:
        """Show what it is and where."""
        kinds = listed(dict.fromkeys(shape.kind for shape in self.link.collisions))
        place = np.array2string(self.pose[:3], precision=3)
        return f"<SceneObject {self.name}: {kinds or 'visual'} at {place}>"


def shape_object(
    name: str,
    kind: str,
    size: Any,
    at: Any,
    options: Mapping[str, Any],
    file: str = "",
) -> SceneObject:
    """Make an object of one shape.

    Args:
        name: Its name.
        kind: Of its shape.
        size: Its sizes in [m], or the scale of a mesh.
        at: Its place in [m], shape (3,), or its pose, shape (7,).
        options: See ``Scene.box``.
        file: The URI of a mesh.

    Raises:
        InvalidValueError: If a value is invalid.
    """
    known = ("rpy", "mass", "color", "may_touch")
    for option in options:
        if option not in known:
            raise InvalidValueError(
                f"{name}: unknown option '{option}'. Known options: {listed(known)}."
            )
    color = _color(name, options.get("color"))
    shape = Shape(kind, tuple(map(float, size)), IDENTITY, file, kind, color=color)
    inertial = inertial_of(name, shape, options.get("mass"))
    return SceneObject(
        Link(name, inertial, (shape,), (shape,)),
        object_pose(name, at, options.get("rpy")),
        may_touch=names_touching(name, options.get("may_touch")),
    )


SIZES = {
    "box": {"size": 3},
    "cylinder": {"radius": 1, "length": 1},
    "sphere": {"radius": 1},
    "plane": {"normal": 3},
    "mesh": {"file": 0},
}
"""What kinds of shapes must have, and how many numbers that is."""


def described_object(
    kind: str, name: str, at: Any, given: Mapping[str, Any]
) -> SceneObject:
    """Make an object of one shape as a scene or a file describes it.

    Args:
        kind: One of ``SIZES``.
        name: Its name.
        at: Its place in [m], shape (3,), or its pose, shape (7,).
        given: Its sizes, by ``SIZES``, and of a mesh also its scale; and the options of
            ``Scene.box``.

    Raises:
        InvalidValueError: If a value is invalid, or a mesh does not exist.
    """
    options, file = dict(given), ""
    size: Any
    if kind == "mesh":
        file = mesh_uri(name, options.pop("file"))
        scale = options.pop("scale", 1.0)
        size = np.broadcast_to(sizes(name, "scale", scale, np.size(scale)), 3)
    elif kind == "plane":
        size = direction(name, options.pop("normal"))
    else:
        size = [
            number
            for key, count in SIZES[kind].items()
            for number in sizes(name, key, options.pop(key), count)
        ]
    return shape_object(name, kind, size, at, options, file)


def with_mass(each: SceneObject, mass: float) -> SceneObject:
    """Give an object a mass in [kg], spread as in a solid of its first shape."""
    inertial = inertial_of(each.name, each.link.collisions[0], mass)
    return replace(each, link=replace(each.link, inertial=inertial))


def names_touching(name: str, given: Any) -> frozenset[str]:
    """Read what may touch an object."""
    touching = given or ()
    if isinstance(touching, str) or not all(isinstance(n, str) for n in touching):
        raise InvalidValueError(f"{name}: may_touch must be a list of names.")
    return frozenset(touching)


def direction(name: str, given: Any) -> np.ndarray:
    """Read the normal of a plane, shape (3,)."""
    vector = numbers(name, "normal", given, 3)
    length = float(np.linalg.norm(vector))
    if length == 0.0:
        raise InvalidValueError(f"The normal of {name} must not be zero.")
    return np.asarray(vector / length)


def model_objects(model: Model) -> Iterator[SceneObject]:
    """Make objects of the links of a model where they are; static ones have no mass.

    The link of a model that has only one is called as the model, others
    ``model::link``.
    """
    is_one = len(model.link_names) == 1
    for link, at in zip(model.link_names, model.poses):
        name = model.name if is_one else model.name + SCOPE + link
        own = replace(model.links[link], name=name)
        if model.assembly.static:
            own = replace(own, inertial=None)
        touching = model.assembly.may_touch.get(link, frozenset())
        yield SceneObject(own, np.array(at), may_touch=touching)


def simple_shape(each: SceneObject) -> Shape | None:
    """Return the only shape of an object, in its frame, with the colour that is seen.

    Returns:
        None if it has several, or looks otherwise.
    """
    shapes, looks = each.link.collisions, each.link.visuals or each.link.collisions
    if len(shapes) != 1 or len(looks) != 1:
        return None
    shape, look = shapes[0], looks[0]
    is_same = (shape.kind, shape.size, shape.filename) == (
        look.kind,
        look.size,
        look.filename,
    )
    is_there = np.array_equal([shape.pose, look.pose], [IDENTITY, IDENTITY])
    return replace(shape, color=look.color) if is_same and is_there else None


def attached(carried: SceneObject, link: str, begin: Any, end: Any) -> SceneObject:
    """Let a link carry an object for a time; see ``Scene.attach``."""
    name = carried.name
    begin, end = (
        time if time in (-np.inf, np.inf) else numbers(name, "time", time, 1)[0]
        for time in (begin, end)
    )
    new = Attachment(str(link), float(begin), float(end))
    every = sorted((*carried.attachments, new), key=lambda one: one.begin)
    ends = [time for one in every for time in (one.begin, one.end)]
    if not begin < end:
        raise InvalidValueError(
            f"{name} cannot be attached to {link} from {begin:g} to {end:g} s: times "
            "must increase."
        )
    if ends != sorted(ends):
        held = listed(f"{one.link} {_span(one)}" for one in carried.attachments)
        raise InvalidValueError(
            f"{name} cannot be attached to {link} {_span(new)}: attachments must not "
            f"overlap, and it is attached to {held}. Detach it first, or give times."
        )
    if any(shape.kind == "plane" for shape in carried.link.collisions):
        raise InvalidValueError(f"{name} cannot be attached: it is a plane.")
    return replace(carried, attachments=tuple(every))


def _span(one: Attachment) -> str:
    """Write the times of an attachment."""
    begin = "the start" if one.begin == -np.inf else f"{one.begin:g} s"
    return f"from {begin} to {'the end' if one.end == np.inf else f'{one.end:g} s'}"


def mesh_uri(name: str, file: str | PathLike[str]) -> str:
    """Return the URI of a mesh.

    Raises:
        InvalidValueError: If there is no such file.
    """
    given = fspath(file)
    uri = given if "://" in given else Path(given).expanduser().absolute().as_uri()
    if local_path(uri, find_folder) is None:
        is_folder = "://" not in given and Path(given).expanduser().is_dir()
        fault = "is a folder" if is_folder else "does not exist"
        raise InvalidValueError(f"The mesh of {name} {fault}: {given}.")
    return uri


def object_pose(name: str, at: Any, rpy: Any = None) -> np.ndarray:
    """Read where an object is.

    Args:
        name: Its name, for messages.
        at: Its place in [m], shape (3,), or its pose, shape (7,).
        rpy: Roll, pitch and yaw in [rad], shape (3,); None: 0, or as in the pose.

    Returns:
        The pose, shape (7,).

    Raises:
        InvalidValueError: If a value is invalid.
    """
    size = np.size(at)
    if size == len(IDENTITY) and rpy is None:
        return one_pose(numbers(name, "pose", at, 7), name)
    if size != 3:
        raise InvalidValueError(
            f"The place of {name} must be x y z in m, or a pose x y z and quaternion "
            f"x y z w (got {str(at)[:80]})."
        )
    turn = IDENTITY[3:] if rpy is None else from_rpy(numbers(name, "rpy", rpy, 3))
    return np.concatenate([numbers(name, "place", at, 3), turn])


def numbers(name: str, what: str, given: Any, count: int) -> np.ndarray:
    """Read some finite numbers, shape (count,)."""
    try:
        found = np.atleast_1d(np.asarray(given, dtype=float))
    except (TypeError, ValueError):
        found = np.zeros(0)
    is_flag = any(isinstance(part, bool) for part in np.ravel(np.array(given, object)))
    if found.shape != (count,) or is_flag or not (np.abs(found) <= MAX_VALUE).all():
        needed = "a number" if count == 1 else f"{count} numbers"
        raise InvalidValueError(
            f"The {what} of {name} must be {needed} (got {str(given)[:80]})."
        )
    return found


def sizes(name: str, what: str, given: Any, count: int = 1) -> tuple[float, ...]:
    """Read sizes in [m]."""
    found = numbers(name, what, given, count)
    if not (found > 0.0).all():
        raise InvalidValueError(
            f"The {what} of {name} must be greater than 0 (got {str(given)[:80]})."
        )
    return tuple(found.tolist())


def _color(name: str, given: Any) -> tuple[float, ...]:
    """Read a colour."""
    if given is None:
        return COLOR
    found = numbers(name, "color", given, 4 if np.size(given) == 4 else 3)
    if not ((found >= 0.0) & (found <= 1.0)).all():
        raise InvalidValueError(
            f"The color of {name} must be red, green and blue from 0 to 1 (got "
            f"{str(given)[:80]})."
        )
    return tuple([*found.tolist(), 1.0][:4])


def inertial_of(name: str, shape: Shape, mass: Any) -> Inertial | None:
    """Compute the mass properties of a solid shape; of a mesh, those of its box."""
    if mass is None:
        return None
    (kilograms,) = sizes(name, "mass", mass)
    kind, lengths, middle = shape.kind, shape.size, np.zeros(3)
    if kind == "plane":
        raise InvalidValueError(f"{name} is a plane and cannot have a mass.")
    if kind == "mesh":
        meshes, left_out = find_meshes([shape])
        if left_out:
            raise InvalidValueError(f"{name} cannot have a mass: {left_out[0]}.")
        points = outline(shape, meshes)[0]
        low, high = points.min(axis=0), points.max(axis=0)
        kind, lengths, middle = "box", high - low, (low + high) / 2.0
    elif kind == "capsule":
        kind, lengths = "cylinder", (lengths[0], lengths[1] + lengths[0])
    moments = kilograms * np.diag(INERTIAS[kind](*lengths))
    axes = to_axes(shape.pose[3:])
    center = shape.pose[:3] + axes @ middle
    return Inertial(kilograms, center, axes @ moments @ axes.T)
