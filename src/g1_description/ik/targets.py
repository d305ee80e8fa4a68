"""Targets of links, as programs give them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from g1_description.bounds import NORM_TOLERANCE
from g1_description.errors import InvalidValueError
from g1_description.ik.tasks import NEAREST, LinkTask
from g1_description.robot.arrays import as_poses
from g1_description.robot.rotation import (
    IDENTITY,
    cross,
    from_axis_angle,
    from_rotation_vector,
    multiply,
    normalized,
    rotate,
    turn_between,
)

ROTATION_WEIGHT = 0.3
"""Weight of rotation errors in [rad], against position errors in [m]."""

POSE_WEIGHTS = np.repeat([1.0, ROTATION_WEIGHT], 3)
"""Weights of a pose, shape (6,)."""

FARTHEST = 100.0
"""Largest distance of a target from the root link at the start, in [m]."""

FARTHEST_POINT = 5.0
"""Largest coordinate of a point of a link, in [m]: a fingertip's in mm is beyond it."""

FORMS = {
    "position": (3, "x y z in m"),
    "rotation": (4, "a quaternion x y z w"),
    "direction": (3, "x y z along the world's axes"),
    "forward": (3, "x y z along the world's axes"),
    "look_at": (3, "x y z in m"),
    "axis": (3, "x y z in its frame"),
    "point": (3, "x y z in its frame"),
}
"""Lengths and forms of the fields of a target."""

X_AXIS = np.array([1.0, 0.0, 0.0])

NEARLY_PARALLEL = 1e-3
"""Sine of an angle up to which two vectors give no turn about one of them."""

OF_LINK = "axis", "point"
"""Fields that do not change from sample to sample."""


@dataclass(frozen=True, eq=False)
class Target:
    """Where a link should be, as far as that matters; what is None is free.

    Only one of ``rotation``, ``direction`` and ``look_at`` is given. Leading axes are
    those of the samples of a path.
    """

    position: Any = None
    """Place of the link's point in the world, x y z in [m], shape (..., 3)."""

    rotation: Any = None
    """Rotation of the link, a quaternion x y z w that takes its coordinates to the
    world's, shape (..., 4)."""

    direction: Any = None
    """Vector in the world along which the axis points, shape (..., 3)."""

    forward: Any = None
    """Vector in the world along which the link's x axis, that of the fingers of hands,
    points as far as the direction of the axis allows, shape (..., 3); None: any turn
    about the direction will do."""

    look_at: Any = None
    """Place in the world at which the axis points, from the link's point, x y z in [m],
    shape (..., 3)."""

    axis: Any = None
    """The axis, a vector in the frame of the link, shape (3,). None: that of the named
    point, else x for ``look_at``."""

    point: Any = None
    """The point, x y z in the frame of the link, in [m], shape (3,). None: that of the
    named point, else its origin."""

    relative_to: str | None = None
    """Object of the scene in whose frame position, rotation, direction, forward and
    look_at are, wherever it is carried; None: the world's."""


def box_targets(
    pose: Any,
    width: Any,
    left: str = "left_palm",
    right: str = "right_palm",
    relative_to: str | None = None,
    pitch: float | None = 0.0,
) -> dict[str, Target]:
    """Put both palms on the sides of a box, facing each other, as it turns.

    Args:
        pose: Pose of the centre of the box in the world, x y z in [m] and quaternion
            x y z w, shape (..., 7); its y axis goes from the right palm to the left.
        width: Of the box along its y axis, in [m], a number or of shape (...).
        left: Named point of the left palm, whose axis is where it faces.
        right: That of the right palm.
        relative_to: Object of the scene in whose frame the pose is; None: the world.
        pitch: Of the fingers below the x axis of the box, in [rad]; None: any, which
            changes along a path, so that a box tips with the hand that carries it.

    Returns:
        Targets by name.

    Raises:
        InvalidValueError: If pose, width or pitch is invalid.
    """
    poses, widths = as_poses(pose, "box"), _numbers(width)
    fits = widths.shape in ((), poses.shape[:-1])
    if not fits or not ((widths >= 0.0) & (widths <= FARTHEST_POINT)).all():
        raise InvalidValueError(
            f"The width of the box must be in m, from 0 to {FARTHEST_POINT:g}, one or "
            f"as many as there are poses (got {str(width)[:40]})."
        )
    if pitch is not None and not (is_number(pitch) and np.isfinite(pitch)):
        raise InvalidValueError(
            f"pitch must be a number in rad, or None (got {str(pitch)[:40]})."
        )
    left_side, forward = rotate(poses[..., 3:], np.array([0.0, 1.0, 0.0])), None
    if pitch is not None:
        fingers = np.array([np.cos(pitch), 0.0, -np.sin(pitch)])
        forward = rotate(poses[..., 3:], fingers)
    return {
        name: Target(
            poses[..., :3] + 0.5 * widths[..., np.newaxis] * side,
            direction=-side,
            forward=forward,
            relative_to=relative_to,
        )
        for name, side in ((left, left_side), (right, -left_side))
    }


def as_target(name: str, given: Any) -> Target:
    """Read a position or pose as a target; one that is a target stays.

    Raises:
        InvalidValueError: If it is something else.
    """
    if isinstance(given, Target):
        return given
    numbers = _numbers(given)
    if numbers.shape[-1:] == (3,):
        return Target(numbers)
    if numbers.shape[-1:] == (7,):
        return Target(numbers[..., :3], numbers[..., 3:])
    raise InvalidValueError(
        f"The target of {name} must be a position x y z, a pose x y z and quaternion "
        f"x y z w, or a Target (got {str(given)[:80]})."
    )


def of_samples(name: str, targets: Sequence[Target]) -> Target:
    """Put the targets of samples together; an axis and a point are the same in all.

    Raises:
        InvalidValueError: If some have a field, and others do not.
    """
    fields: dict[str, Any] = {}
    for form in FORMS:
        values = [getattr(target, form) for target in targets]
        given = [value for value in values if value is not None]
        if 0 < len(given) < len(values):
            raise InvalidValueError(
                f"The targets of {name} must have a {form} at all times, or at none."
            )
        is_one = all(np.array_equal(given[0], value) for value in given)
        if given:
            fields[form] = given[0] if is_one and form in OF_LINK else given
    return Target(**fields)


def read_task(
    name: str, target: Target, link: int, times: np.ndarray | None = None
) -> LinkTask:
    """Read the target of a link.

    Args:
        name: Name of the link, for messages.
        target: Its target.
        link: Row of the link.
        times: Times of the samples, shape (n_samples,); None: there is only one.

    Returns:
        The task, with the axis of the samples if there are times.

    Raises:
        InvalidValueError: If the target is invalid.
    """
    if not isinstance(target.relative_to, (str, type(None))):
        raise InvalidValueError(
            f"relative_to of {name} must be the name of an object of the scene (got "
            f"{str(target.relative_to)[:80]})."
        )
    given = {form for form in FORMS if getattr(target, form) is not None}
    turned = sorted(given & {"rotation", "direction", "look_at"})
    if len(turned) > 1 or {"rotation", "axis"} <= given:
        both = " and ".join([*turned, "axis"][:2])
        raise InvalidValueError(
            f"The target of {name} has both {both}: give a rotation, or an axis with a "
            "direction or look_at."
        )
    if "axis" in given and not turned:
        raise InvalidValueError(
            f"The axis of {name} needs a direction along which it points, or a look_at."
        )
    if "direction" in given and "axis" not in given:
        raise InvalidValueError(
            f"The direction of {name} needs an axis of the link that points along it."
        )
    if "forward" in given and "direction" not in given:
        raise InvalidValueError(
            f"The forward of {name} needs a direction to which it is added."
        )
    if not turned and "position" not in given:
        raise InvalidValueError(
            f"The target of {name} needs a position, rotation, direction or look_at."
        )
    read = {form: _read(form, name, getattr(target, form), times) for form in given}
    samples = () if times is None else times.shape
    place = read.get("position", np.zeros((*samples, 3)))
    rotation = read.get("rotation", np.broadcast_to(IDENTITY, (*samples, 4)))
    is_given = np.repeat(["position" in given, bool(turned)], 3)
    axis = read.get("axis")
    if axis is None and "look_at" in given:
        axis = X_AXIS
    direction = read.get("direction")
    if "forward" in given:
        assert axis is not None and direction is not None
        rotation = _rotation(name, axis, direction, read["forward"])
        axis = direction = None
    return LinkTask(
        link,
        np.concatenate([place, rotation], axis=-1),
        POSE_WEIGHTS * is_given,
        read.get("point", np.zeros(3)),
        axis,
        direction,
        read.get("look_at"),
    )


def check_places(
    name: str,
    task: LinkTask,
    root: np.ndarray,
    link: np.ndarray,
    times: np.ndarray | None = None,
) -> None:
    """Refuse targets that are far from the robot, or at the eyes that look at them.

    Args:
        name: Name of the link, for messages.
        task: Its task.
        root: Position of the root link at the start, in [m], shape (3,).
        link: Pose of the link at the start, shape (7,).
        times: As for ``read_task``.

    Raises:
        InvalidValueError: If there is such a target.
    """
    is_placed = bool(task.weights[:3].any())
    places = {"target": task.pose[..., :3]} if is_placed else {}
    if task.look_at is not None:
        places["look_at"] = task.look_at
        eye = (
            task.pose[..., :3] if is_placed else link[:3] + rotate(link[3:], task.point)
        )
        is_near = np.linalg.norm(task.look_at - eye, axis=-1) < NEAREST
        if is_near.any():
            raise InvalidValueError(
                f"The look_at of {name}{_when(is_near, times)} is at the link itself, "
                f"not at least {1e3 * NEAREST:g} mm from its point."
            )
    for of, place in places.items():
        far = np.linalg.norm(place - root, axis=-1)
        if (far > FARTHEST).any():
            raise InvalidValueError(
                f"The {of} of {name}{_when(far > FARTHEST, times)} is {far.max():.3g} "
                f"m from the robot: targets are in m, at most {FARTHEST:g} m away."
            )


def check_mapping(label: str, given: object) -> None:
    """Refuse a value that is no dictionary.

    Raises:
        InvalidValueError: If it is none.
    """
    if not isinstance(given, Mapping):
        raise InvalidValueError(
            f"{label} must be a dictionary by link (got {str(given)[:80]})."
        )
    wrong = [key for key in given if not isinstance(key, str)]
    if wrong:
        raise InvalidValueError(
            f"{label} must be a dictionary by the names of links (got {wrong[0]!r})."
        )


def is_number(given: object) -> bool:
    """Return whether a value is a number."""
    return isinstance(given, (int, float, np.number)) and not isinstance(given, bool)


def _read(form: str, name: str, given: Any, times: np.ndarray | None) -> np.ndarray:
    """Read a field of a target, with the axis of the samples if there are times."""
    numbers, (width, text) = _numbers(given), FORMS[form]
    label = f"The {'quaternion' if form == 'rotation' else form} of {name}"
    if numbers.shape[-1:] != (width,):
        raise InvalidValueError(f"{label} must be {text} (got {str(given)[:80]}).")
    samples = () if times is None or form in OF_LINK else times.shape
    if numbers.shape[:-1] not in ((), samples):
        if samples and numbers.ndim == 2:
            raise InvalidValueError(
                f"There are {samples[0]} times but {len(numbers)} targets of {name}."
            )
        raise InvalidValueError(
            f"{label} must be one {text} (got shape {numbers.shape})."
        )
    is_wrong = ~np.isfinite(numbers).all(axis=-1)
    if is_wrong.any():
        raise InvalidValueError(
            f"{label}{_when(is_wrong, times)} must be {text}, of finite numbers."
        )
    lengths = np.linalg.norm(numbers, axis=-1, keepdims=True)
    if form == "rotation":
        is_wrong = np.abs(lengths[..., 0] - 1.0) > NORM_TOLERANCE
        if is_wrong.any():
            wrong = lengths[is_wrong].flat[0]
            raise InvalidValueError(
                f"{label}{_when(is_wrong, times)} must have length 1 (got {wrong:.6g})."
            )
        numbers = normalized(numbers)
    elif form in ("axis", "direction", "forward"):
        is_wrong = lengths[..., 0] == 0.0
        if is_wrong.any():
            raise InvalidValueError(
                f"{label}{_when(is_wrong, times)} must not have length 0."
            )
        numbers = numbers / lengths
    elif form == "point" and np.abs(numbers).max() > FARTHEST_POINT:
        raise InvalidValueError(
            f"{label} is {np.abs(numbers).max():.3g} m from the link's origin along an "
            f"axis: points are in m, at most {FARTHEST_POINT:g} m away."
        )
    return np.broadcast_to(numbers, (*samples, width))


def _rotation(
    name: str, axis: np.ndarray, direction: np.ndarray, forward: np.ndarray
) -> np.ndarray:
    """Find rotations that take an axis to directions, and x as near forward as then."""
    lengths = np.linalg.norm(cross(direction, forward), axis=-1)
    if min(lengths.min(), np.linalg.norm(cross(axis, X_AXIS))) < NEARLY_PARALLEL:
        raise InvalidValueError(
            f"The forward of {name} must not be along its direction, nor the axis "
            "along the x axis of the link."
        )
    turn = from_rotation_vector(turn_between(axis, direction))
    now = rotate(turn, X_AXIS)
    sine = (direction * cross(now, forward)).sum(axis=-1)
    along = [(direction * each).sum(axis=-1) for each in (now, forward)]
    cosine = (now * forward).sum(axis=-1) - along[0] * along[1]
    return multiply(from_axis_angle(direction, np.arctan2(sine, cosine)), turn)


def _when(is_wrong: np.ndarray, times: np.ndarray | None) -> str:
    """Name the time of the first wrong sample, where there are several."""
    if times is None or not np.ndim(is_wrong):
        return ""
    return f" at {times[int(np.argmax(is_wrong))]:.3f} s"


def _numbers(given: Any) -> np.ndarray:
    """Read numbers; none if these are not numbers."""
    try:
        return np.array(given, dtype=float)
    except (TypeError, ValueError):
        return np.zeros(0)
