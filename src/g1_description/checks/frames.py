"""What must be measured at each sample of a motion, in pieces that fit into memory."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np

from g1_description.checks.balance import (
    Balance,
    long_still,
    margins,
    zero_moment_points,
)
from g1_description.checks.ground import Ground, GroundFrames, GroundPiece
from g1_description.checks.states import States
from g1_description.checks.thresholds import Thresholds
from g1_description.collisions.distances import Contacts
from g1_description.collisions.self_collisions import SelfCollisions
from g1_description.robot.description import Joint
from g1_description.robot.dynamics import GRAVITY, Dynamics, Masses, inverse_dynamics
from g1_description.robot.kinematics import Kinematics


@dataclass(frozen=True)
class Parts:
    """What is known of a robot before any motion."""

    joints: tuple[Joint, ...]
    """The movable ones."""

    ground_links: tuple[str, ...]
    """Links with an outline."""

    kinematics: Kinematics
    masses: Masses
    ground: Ground
    collisions: SelfCollisions
    thresholds: Thresholds


@dataclass(frozen=True, eq=False)
class Frames:
    """Measurements at successive samples; None where they are not wanted."""

    contacts: Contacts | None = None
    ground: GroundFrames | None = None
    balance: Balance | None = None
    efforts: np.ndarray | None = None
    """Of the joints of a robot that is fixed, in [N m] or [N], shape (n, n_joints)."""


@dataclass(frozen=True, eq=False)
class _Piece:
    """Measurements at some successive samples; None where they are not wanted."""

    contacts: Contacts | None = None
    ground: GroundPiece | None = None
    center: np.ndarray | None = None
    zmp: np.ndarray | None = None
    is_still: np.ndarray | None = None
    efforts: np.ndarray | None = None


def measure(states: States, parts: Parts, wanted: Collection[str]) -> Frames:
    """Measure a motion.

    Args:
        states: The motion.
        parts: The robot.
        wanted: What is: ``contacts``, ``ground``, ``balance``, ``efforts``.
    """
    pieces = [_piece(states, piece, parts, wanted) for piece in states.chunks()]
    grounds = [piece.ground for piece in pieces if piece.ground is not None]
    ground = parts.ground.frames(grounds, states.times) if grounds else None
    return Frames(
        _joined_contacts(pieces) if "contacts" in wanted else None,
        ground,
        None if ground is None else _balance(pieces, ground, states.times),
        _joined([piece.efforts for piece in pieces]),
    )


def _piece(
    states: States, piece: slice, parts: Parts, wanted: Collection[str]
) -> _Piece:
    """Measure some samples."""
    times = states.times[piece]
    base, positions, twists, velocities = states.at(times)
    poses, moves = parts.kinematics.link_states(base, positions, twists, velocities)
    contacts = ground = None
    if "contacts" in wanted:
        contacts = parts.collisions.contacts(poses)
        contacts.frame[:] += piece.start
    if "ground" in wanted:
        ground = parts.ground.piece(poses, moves)
    has_mass = parts.masses.total > 0.0
    if not (has_mass and {"balance", "efforts"} & set(wanted)):
        return _Piece(contacts, ground)
    motion = states.dynamics(times, parts.thresholds.window)
    dynamics = inverse_dynamics(parts.kinematics, parts.masses, motion)
    efforts = dynamics.efforts if "efforts" in wanted else None
    if "balance" not in wanted:
        return _Piece(contacts, ground, efforts=efforts)
    weight, floor = parts.masses.total * GRAVITY, parts.thresholds.floor_height
    return _Piece(
        contacts,
        ground,
        dynamics.center_of_mass,
        zero_moment_points(dynamics, weight, floor),
        _is_still(dynamics, parts.masses.robot_velocity(poses, moves), parts),
        efforts,
    )


def _is_still(dynamics: Dynamics, velocity: np.ndarray, parts: Parts) -> np.ndarray:
    """Tell where the centre of mass is still.

    Args:
        dynamics: Of the motion.
        velocity: Of the centre of mass in [m/s], shape (n, 3).
        parts: The robot.
    """
    acceleration = dynamics.root_wrench[:, :3] / parts.masses.total
    acceleration[:, 2] -= GRAVITY
    is_slow = np.linalg.norm(velocity, axis=1) < parts.thresholds.still_speed
    most = parts.thresholds.still_acceleration
    return is_slow & (np.linalg.norm(acceleration, axis=1) < most)


def _balance(
    pieces: list[_Piece], ground: GroundFrames, times: np.ndarray
) -> Balance | None:
    """Find how far inside what bears the weight acts; None where that is unknown."""
    center = _joined([piece.center for piece in pieces])
    zmp = _joined([piece.zmp for piece in pieces])
    is_still = _joined([piece.is_still for piece in pieces])
    if center is None or zmp is None or is_still is None:
        return None
    of_center, of_zmp = margins(ground.support, center[:, :2], zmp)
    return Balance(center, of_center, of_zmp, long_still(times, is_still))


def _joined(arrays: list[np.ndarray | None]) -> np.ndarray | None:
    """Chain arrays of successive samples; None where there are none."""
    known = [array for array in arrays if array is not None]
    return np.concatenate(known) if known else None


def _joined_contacts(pieces: list[_Piece]) -> Contacts:
    """Chain contacts of successive samples."""
    found = [piece.contacts for piece in pieces if piece.contacts is not None]
    names = ("frame", "pair", "distance", "points_a", "points_b", "normal")
    return Contacts(
        *(np.concatenate([getattr(part, name) for part in found]) for name in names)
    )
