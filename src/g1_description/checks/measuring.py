"""Measurements of a motion, made in chunks of its times."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Any

import numpy as np

from g1_description.checks.measured import CheckedRobot, Measure, Measured
from g1_description.checks.support import (
    Balance,
    long_still,
    margins,
)
from g1_description.checks.surroundings import Surroundings
from g1_description.checks.thresholds import Thresholds
from g1_description.collisions.contacts import Contacts
from g1_description.motion.motion import Motion
from g1_description.robot.dynamics import (
    GRAVITY,
    Dynamics,
    Masses,
    RobotMotion,
    inverse_dynamics,
)
from g1_description.robot.rotation import cross


def measure(
    robot: CheckedRobot,
    motion: Motion,
    needs: Collection[str],
    own: Mapping[str, Measure],
    objects: np.ndarray | None = None,
) -> Measured:
    """Measure a motion.

    Args:
        robot: The robot.
        motion: Trajectory of joints that it has.
        needs: ``ground``, ``center``, ``balance``, ``efforts``, ``forces``,
            ``objects``; others are ignored.
        own: Measurements of rules, by name.
        objects: Poses of the objects in the map if they are not those of the scene,
            shape (n_objects, 7).

    Raises:
        MotionError: If the motion is too long.
    """
    found = Measured(robot, motion)
    if robot.obstacles is not None and not robot.lacks("objects", motion):
        found.surroundings = Surroundings(
            robot.obstacles,
            robot.thresholds,
            robot.description,
            found.link_poses,
            robot.is_fixed,
            objects,
        )
    pieces = [_piece(found, piece, needs, own) for piece in found.chunks()]

    def joined(name: str) -> np.ndarray | None:
        known = [piece[name] for piece in pieces if name in piece]
        return np.concatenate(known) if known else None

    for name in own:
        values = [piece["own"][name] for piece in pieces]
        is_array = isinstance(values[0], np.ndarray)
        join = np.concatenate if is_array else Contacts.joined
        found.own[name] = join(values)
    found.efforts, found.wrench = joined("efforts"), joined("wrench")
    found.power, found.weight = joined("power"), joined("weight")
    if "ground" in pieces[0]:
        grounds = [piece["ground"] for piece in pieces]
        found.ground = robot.ground.samples(grounds, found.times)
    if found.surroundings is not None and "objects" in needs:
        near = Contacts.joined([piece["objects"] for piece in pieces])
        rows = robot.ground.rows[found.ground.columns] if found.ground else np.zeros(0)
        around = found.surroundings
        found.near_objects = around.without_supports(
            found.times, near, found.ground, rows
        )
    center, is_still = joined("center"), joined("is_still")
    if not (found.ground is None or center is None or is_still is None):
        inside = margins(found.ground.support, center[:, :2])
        still = long_still(found.times, is_still)
        found.balance = Balance(center, inside, still)
    return found


def _piece(
    motion: Measured, piece: slice, needs: Collection[str], own: Mapping[str, Measure]
) -> dict[str, Any]:
    """Measure some samples."""
    robot, times = motion.robot, motion.times[piece]
    base, positions, twists, velocities = motion.at(times)
    poses, moves = robot.kinematics.link_states(base, positions, twists, velocities)
    found: dict[str, Any] = {
        "own": {name: find(robot, poses) for name, find in own.items()}
    }
    around, surfaces = motion.surroundings, None
    if around is not None:
        surfaces = around.surfaces
        if "objects" in needs:
            found["objects"] = around.contacts(times, poses)
    for values in (*found["own"].values(), found.get("objects")):
        if isinstance(values, Contacts):
            values.sample[:] += piece.start
    is_on_floor = not robot.lacks("ground", motion.motion)
    from_floor = {"ground", "balance", "forces", "efforts"} & set(needs)
    if is_on_floor and (from_floor or surfaces is not None):
        found["ground"] = robot.ground.piece(poses, moves, surfaces)
    has_mass = robot.masses.total > 0.0
    if not (has_mass and {"center", "balance", "efforts", "forces"} & set(needs)):
        return found
    masses = robot.masses if around is None else around.loaded(robot.masses, times)
    moving = motion.dynamics(times)
    dynamics = inverse_dynamics(robot.kinematics, masses, moving)
    found["power"] = _power(dynamics, moving)
    found["weight"] = np.broadcast_to(masses.total * GRAVITY, len(times))
    if {"efforts", "forces"} & set(needs):
        found["efforts"], found["wrench"] = dynamics.efforts, dynamics.root_wrench
    if "ground" in found:
        speed = masses.robot_velocity(poses, moves)
        found["center"] = dynamics.center_of_mass
        found["is_still"] = _is_still(dynamics, speed, masses, robot.thresholds)
    return found


def _power(dynamics: Dynamics, moving: RobotMotion) -> np.ndarray:
    """Compute the power of joints and of the wrench at the root, shape (n,)."""
    turning = moving.root_twists[:, 3:]
    # The wrench is about the world's origin: so is the velocity.
    at_origin = moving.root_twists[:, :3] - cross(turning, moving.T_world_root[:, :3])
    twists = np.concatenate([at_origin, turning], axis=1)
    of_root = (dynamics.root_wrench * twists).sum(axis=1)
    return of_root + (dynamics.efforts * moving.velocities).sum(axis=1)


def _is_still(
    dynamics: Dynamics, velocity: np.ndarray, masses: Masses, thresholds: Thresholds
) -> np.ndarray:
    """Find where the centre of mass is still; velocity is in [m/s], shape (n, 3)."""
    acceleration = dynamics.root_wrench[:, :3] / masses.total[..., np.newaxis]
    acceleration[:, 2] -= GRAVITY
    is_slow = np.linalg.norm(velocity, axis=1) < thresholds.still_speed
    most = thresholds.still_acceleration
    return is_slow & (np.linalg.norm(acceleration, axis=1) < most)
