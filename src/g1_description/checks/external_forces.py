"""Forces on a robot that neither the floor nor its motors explain."""

from __future__ import annotations

import numpy as np

from g1_description.checks.measured import Measured
from g1_description.robot.dynamics import GRAVITY
from g1_description.robot.kinematics import Kinematics
from g1_description.robot.rotation import cross

DAMPED = 1e-3
"""How little no wrench at all is preferred to one."""

LEVER = 0.3
"""Moments in comparison with forces, in [m]."""


def external_forces(measured: Measured, efforts: np.ndarray) -> dict[str, np.ndarray]:
    """Find forces at the ends of limbs and on the root link.

    Unknown wrenches at the origins of these links are in equilibrium with the motion
    and the efforts of the motors: six equations of the whole robot and one of each
    joint, least squares. A limb of six joints determines the wrench at its end.

    Args:
        measured: A motion, with its inverse dynamics.
        efforts: Efforts of all joints, means over the window of accelerations, in
            [N m] or [N], shape (n, n_joints).

    Returns:
        By link, the root last: forces along the map's axes in [N], shape (n, 3). Those
        on feet include the forces of the floor.
    """
    robot, kinematics = measured.robot, measured.robot.kinematics
    assert measured.wrench is not None
    assert measured.efforts is not None
    links = _ends(kinematics)
    weight = float(robot.masses.total) * GRAVITY
    limits = np.array([joint.effort or np.inf for joint in robot.joints])
    limits = np.where(np.isfinite(limits), limits, LEVER * weight)
    scale = np.concatenate([[weight] * 3, [LEVER * weight] * 3, limits])
    sizes = np.tile([weight] * 3 + [LEVER * weight] * 3, len(links))
    above = kinematics.joints_above[links]
    found = np.zeros((len(measured.times), len(links), 3))
    for piece in measured.chunks():
        base, positions = measured.at(measured.times[piece])[:2]
        poses, origin, axis = kinematics.place(base, positions)
        screws = kinematics.joint_screws(origin, axis)
        wrenches = _unit_wrenches(poses[:, links, :3])
        moved = np.einsum("njk,nlmk->njlm", screws, wrenches)
        moved *= above.T[:, :, np.newaxis]
        root = poses[:, links[-1], :3]
        whole = np.moveaxis(_about(root[:, np.newaxis, np.newaxis], wrenches), 3, 1)
        left = np.concatenate([whole, moved], axis=1)
        left = left.reshape(*left.shape[:2], -1) * sizes / scale[:, np.newaxis]
        need = _about(root, measured.wrench[piece])
        lacking = measured.efforts[piece] - efforts[piece]
        right = np.concatenate([need, lacking], axis=1) / scale
        turned = np.swapaxes(left, 1, 2)
        square = turned @ left + DAMPED**2 * np.eye(len(sizes))
        solved = np.linalg.solve(square, turned @ right[..., np.newaxis])[..., 0]
        found[piece] = (solved * sizes).reshape(len(poses), -1, 6)[..., :3]
    return {robot.links[row]: found[:, n] for n, row in enumerate(links)}


def _ends(kinematics: Kinematics) -> np.ndarray:
    """List a link at the end of each limb, and the root link last."""
    root = (~kinematics.joints_above.any(axis=1)).argmax()
    return np.append(kinematics.limb_ends(), root)


def _unit_wrenches(points: np.ndarray) -> np.ndarray:
    """Return unit forces and moments at points, about the map's origin.

    Args:
        points: Shape (n, n_links, 3).

    Returns:
        Shape (n, n_links, 6, 6), a row each.
    """
    found = np.zeros((*points.shape[:2], 6, 6))
    found[...] = np.eye(6)
    axes = np.broadcast_to(np.eye(3), (*points.shape[:2], 3, 3))
    levers = np.broadcast_to(points[:, :, np.newaxis], axes.shape)
    found[..., :3, 3:] = cross(levers, axes)
    return found


def _about(point: np.ndarray, wrench: np.ndarray) -> np.ndarray:
    """Move wrenches about the map's origin to points; shapes (..., 6), (..., 3)."""
    moved = wrench.copy()
    moved[..., 3:] -= cross(
        np.broadcast_to(point, moved[..., :3].shape), moved[..., :3]
    )
    return moved
