"""Ways from here to there: samples of positions and poses for targets of links.

All are from rest to rest with minimum jerk. Source: Flash and Hogan, J. Neuroscience,
1985.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from g1_description.errors import InvalidValueError
from g1_description.ik.targets import FARTHEST, is_number
from g1_description.motion.edit import minimum_jerk_fraction
from g1_description.robot.arrays import as_numbers, as_poses
from g1_description.robot.rotation import (
    cross,
    from_axis_angle,
    multiply,
    rotate,
    shorter_turn,
)

TOP_SPEED, TOP_ACCELERATION = 1.875, 10.0 / np.sqrt(3.0)
"""Largest speed and acceleration of minimum jerk, for a way of 1 in a time of 1."""

STRAIGHT = 1e-6
"""Sine of the angle at which three places are on a line."""


def line(
    start: Any,
    end: Any,
    speed: float = 0.3,
    *,
    turn_speed: float = 1.0,
    acceleration: float = 1.0,
    period: float = 0.02,
) -> tuple[np.ndarray, np.ndarray]:
    """Go straight from one place to another, and turn at a steady share of it.

    Args:
        start: Position x y z in [m], shape (3,), or pose x y z and quaternion x y z w,
            shape (7,).
        end: Likewise.
        speed: Largest speed, in [m/s].
        turn_speed: Largest angular velocity, in [rad/s].
        acceleration: Largest acceleration, in [m/s^2] and [rad/s^2].
        period: Longest time between samples, in [s].

    Returns:
        Times from 0 on in [s], shape (n,), and positions, shape (n, 3), or poses, shape
        (n, 7).

    Raises:
        InvalidValueError: If an argument is invalid.
    """
    begin, goal = _places(start=start, end=end)
    length = float(np.linalg.norm(goal[:3] - begin[:3]))
    turned = _turned(begin, goal)
    options = speed, turn_speed, acceleration, period
    times, shares = _timed(length, 0.0, turned, *options)
    places = begin[:3] + shares[:, np.newaxis] * (goal[:3] - begin[:3])
    return times, _with_rotations(begin, goal, places, shares)


def arc(
    start: Any,
    middle: Any,
    end: Any,
    speed: float = 0.3,
    *,
    turn_speed: float = 1.0,
    acceleration: float = 1.0,
    period: float = 0.02,
) -> tuple[np.ndarray, np.ndarray]:
    """Go through a middle point on an arc of a circle, such as over an edge.

    Args:
        start: As for ``line``.
        middle: Position x y z on the way, in [m], shape (3,).
        end: As for ``line``.
        speed: As for ``line``.
        turn_speed: As for ``line``.
        acceleration: Along the way, as for ``line``, and towards the centre.
        period: As for ``line``.

    Returns:
        As for ``line``.

    Raises:
        InvalidValueError: If an argument is invalid, or the three are on a line.
    """
    begin, goal = _places(start=start, end=end)
    u, v = _vector("middle", middle) - begin[:3], goal[:3] - begin[:3]
    normal = cross(u, v)
    area = float(np.linalg.norm(normal))
    if area <= STRAIGHT * np.linalg.norm(u) * np.linalg.norm(v):
        raise InvalidValueError("start, middle and end are on a line: use line.")
    # Its centre has the same distance from all three.
    out = cross(normal, u) * (v @ v) + cross(v, normal) * (u @ u)
    center = begin[:3] + out / (2.0 * area**2)
    axis, first, last = normal / area, begin[:3] - center, goal[:3] - center
    angle = float(np.arctan2(axis @ cross(first, last), first @ last)) % (2.0 * np.pi)
    length, turned = angle * float(np.linalg.norm(first)), _turned(begin, goal)
    options = speed, turn_speed, acceleration, period
    times, shares = _timed(length, angle, turned, *options)
    places = center + rotate(from_axis_angle(axis, angle * shares), first)
    return times, _with_rotations(begin, goal, places, shares)


def turn(
    start: Any,
    center: Any,
    axis: Any,
    angle: float,
    speed: float = 0.3,
    *,
    turn_speed: float = 1.0,
    acceleration: float = 1.0,
    period: float = 0.02,
) -> tuple[np.ndarray, np.ndarray]:
    """Turn about an axis, such as that of a door's hinges or of a wheel.

    Args:
        start: As for ``line``; a pose turns with it.
        center: A position on the axis, x y z in [m], shape (3,).
        axis: Vector along it, shape (3,).
        angle: Counterclockwise about it, in [rad].
        speed: As for ``line``.
        turn_speed: As for ``line``.
        acceleration: Along the way, as for ``line``, and towards the centre.
        period: As for ``line``.

    Returns:
        As for ``line``.

    Raises:
        InvalidValueError: If an argument is invalid.
    """
    (begin,) = _places(start=start)
    middle, along = _vector("center", center), _vector("axis", axis)
    long = float(np.linalg.norm(along))
    if long == 0.0:
        raise InvalidValueError("axis must not have length 0.")
    if not is_number(angle) or not np.isfinite(angle):
        raise InvalidValueError(f"angle must be a number in rad (got {angle}).")
    out, around = begin[:3] - middle, along / long
    length = abs(angle) * float(np.linalg.norm(cross(around, out)))
    turned = abs(angle) if len(begin) == 7 else 0.0
    options = speed, turn_speed, acceleration, period
    times, shares = _timed(length, abs(angle), turned, *options)
    turns = from_axis_angle(around, angle * shares)
    places = middle + rotate(turns, out)
    if len(begin) == 3:
        return times, places
    return times, np.concatenate([places, multiply(turns, begin[3:])], axis=1)


def _places(**given: Any) -> list[np.ndarray]:
    """Read positions or poses, all of one kind."""
    read = [
        as_poses(place, name) if np.shape(place) == (7,) else _vector(name, place)
        for name, place in given.items()
    ]
    if len({len(place) for place in read}) > 1:
        raise InvalidValueError("start and end must both be positions, or both poses.")
    return read


def _vector(name: str, given: Any) -> np.ndarray:
    """Read three numbers."""
    numbers = as_numbers(given, name)
    if numbers.shape != (3,) or not np.isfinite(numbers).all():
        pose = ", or a pose x y z and quaternion x y z w" * (name in ("start", "end"))
        raise InvalidValueError(
            f"{name} must be three finite numbers x y z{pose} (got {str(given)[:80]})."
        )
    return numbers


def _timed(
    length: float,
    angle: float,
    turned: float,
    speed: float,
    turn_speed: float,
    acceleration: float,
    period: float,
) -> tuple[np.ndarray, np.ndarray]:
    """Find the times of samples, and the shares of the way until then, shape (n,).

    The way is an arc of an angle; 0: a line.
    """
    if length > FARTHEST:
        raise InvalidValueError(
            f"The way is {length:.3g} m long: places are in m, at most {FARTHEST:g} m "
            "apart."
        )
    options = {
        "speed": speed,
        "turn_speed": turn_speed,
        "acceleration": acceleration,
        "period": period,
    }
    for name, given in options.items():
        if not is_number(given) or not 0.0 < given < np.inf:
            raise InvalidValueError(
                f"{name} must be a number greater than 0 (got {given})."
            )
    duration = max(
        TOP_SPEED * length / speed,
        TOP_SPEED * turned / turn_speed,
        np.sqrt(TOP_ACCELERATION * max(length, turned) / acceleration),
        TOP_SPEED * np.sqrt(length * angle / acceleration),
    )
    fractions = np.linspace(0.0, 1.0, int(np.ceil(duration / period)) + 1)
    return duration * fractions, minimum_jerk_fraction(fractions)


def _turned(begin: np.ndarray, goal: np.ndarray) -> float:
    """Return the angle between two poses, in [rad]; 0 for positions."""
    if len(begin) == 3:
        return 0.0
    return 2.0 * float(shorter_turn(begin[3:], goal[3:])[1][0])


def _with_rotations(
    begin: np.ndarray, goal: np.ndarray, places: np.ndarray, shares: np.ndarray
) -> np.ndarray:
    """Turn from one pose to another on the way, about one axis."""
    if len(begin) == 3:
        return places
    axis, half = shorter_turn(begin[3:], goal[3:])
    turns = multiply(begin[3:], from_axis_angle(axis, 2.0 * half * shares))
    return np.concatenate([places, turns], axis=1)
