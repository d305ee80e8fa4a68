"""What must be measured at each sample of a motion, in pieces that fit into memory."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np

from g1_description.core.checks.balance import Balance, margins, zero_moment_points
from g1_description.core.checks.ground import Ground, GroundFrames
from g1_description.core.checks.states import States
from g1_description.core.checks.thresholds import Thresholds
from g1_description.core.dynamics.inverse_dynamics import Dynamics, inverse_dynamics
from g1_description.core.dynamics.masses import GRAVITY, Masses
from g1_description.core.robot.description import Joint
from g1_description.core.robot.kinematics import Kinematics
from g1_description.sim.collisions.self_collisions import SelfCollisions
from g1_description.sim.collisions.shape_collisions import Contacts


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


def measure(states: States, parts: Parts, wanted: Collection[str]) -> Frames:
    """Measure a motion.

    Args:
        states: The motion.
        parts: The robot.
        wanted: What is: ``contacts``, ``ground``, ``balance``, ``efforts``.
    """
    pieces = [_piece(states, piece, parts, wanted) for piece in states.chunks()]
    grounds = [piece.ground for piece in pieces if piece.ground is not None]
    balances = [piece.balance for piece in pieces if piece.balance is not None]
    efforts = [piece.efforts for piece in pieces if piece.efforts is not None]
    return Frames(
        _joined_contacts(pieces) if "contacts" in wanted else None,
        GroundFrames.joined(grounds) if grounds else None,
        Balance.joined(balances) if balances else None,
        np.concatenate(efforts) if efforts else None,
    )


def _piece(
    states: States, piece: slice, parts: Parts, wanted: Collection[str]
) -> Frames:
    """Measure some samples."""
    times = states.times[piece]
    base, positions, twists, velocities = states.at(times)
    poses, moves = parts.kinematics.link_states(base, positions, twists, velocities)
    contacts = ground = None
    if "contacts" in wanted:
        contacts = parts.collisions.contacts(poses)
        contacts.frame[:] += piece.start
    if "ground" in wanted:
        ground = parts.ground.frames(poses, moves)
    if not {"balance", "efforts"} & set(wanted):
        return Frames(contacts, ground)
    motion = states.dynamics(times, parts.thresholds.window)
    dynamics = inverse_dynamics(parts.kinematics, parts.masses, motion)
    efforts = dynamics.efforts if "efforts" in wanted else None
    if ground is None or "balance" not in wanted:
        return Frames(contacts, ground, efforts=efforts)
    velocity = parts.masses.robot_velocity(poses, moves)
    balance = _balance(dynamics, velocity, ground, parts)
    return Frames(contacts, ground, balance, efforts)


def _balance(
    dynamics: Dynamics, velocity: np.ndarray, ground: GroundFrames, parts: Parts
) -> Balance:
    """Find where the weight acts, and whether the robot is still.

    Args:
        dynamics: Of the motion.
        velocity: Of the centre of mass in [m/s], shape (n, 3).
        ground: How the robot stands.
        parts: The robot.
    """
    thresholds, masses = parts.thresholds, parts.masses
    acceleration = dynamics.root_wrench[:, :3] / masses.total
    acceleration[:, 2] -= GRAVITY
    is_slow = np.linalg.norm(velocity, axis=1) < thresholds.still_speed
    is_steady = np.linalg.norm(acceleration, axis=1) < thresholds.still_acceleration
    weight = masses.total * GRAVITY
    zmp = zero_moment_points(dynamics, weight, thresholds.floor_height)
    center = dynamics.center_of_mass
    of_center, of_zmp = margins(ground.support, center[:, :2], zmp)
    return Balance(center, of_center, of_zmp, is_slow & is_steady)


def _joined_contacts(pieces: list[Frames]) -> Contacts:
    """Chain contacts of successive samples."""
    found = [piece.contacts for piece in pieces if piece.contacts is not None]
    names = ("frame", "pair", "distance", "points_a", "points_b", "normal")
    return Contacts(
        *(np.concatenate([getattr(part, name) for part in found]) for name in names)
    )
