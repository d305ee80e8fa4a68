"""How high a robot stands."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from ..core.assembly import Assembly
from ..core.transform import IDENTITY
from .body import Body
from .bullet import BulletClient, connect
from .model import Model
from .urdf_import import load_model

GAP = 0.0005
"""Least distance from the floor, in [m]: what touches is pushed away."""

FAR = 1e4
"""Robots are smaller, in [m]."""


def standing_height(
    assembly: Assembly,
    rotation: np.ndarray,
    package_folder: Callable[[str], str | None],
) -> float:
    """Find the height at which a robot stands on the floor, which is z = 0.

    Args:
        assembly: The robot, its joints where they begin.
        rotation: How the model frame is turned in the world, shape (4,).
        package_folder: Gives a package's folder, None if there is no such package.

    Returns:
        The least height of the model frame in whole millimetres, in [m], at which all
        collision shapes are above the floor; without any, all links' origins.

    Raises:
        DescriptionError: If PyBullet refuses the robot.
    """
    pose = np.concatenate([IDENTITY[:3], rotation])
    model = Model("standing", assembly, pose)
    client = connect()
    try:
        lowest = _lowest_point(client, model, package_folder)
    finally:
        client.disconnect()
    if math.isinf(lowest):
        lowest = model.poses[:, 2].min(initial=0.0)
    return math.ceil((GAP - lowest) * 1000.0) / 1000.0


def _lowest_point(
    client: BulletClient, model: Model, package_folder: Callable[[str], str | None]
) -> float:
    """Find the height of a model's lowest point in [m]; infinite without shapes."""
    if not model.link_names:
        return math.inf
    number, _ = load_model(client, model, package_folder)
    Body(client, number, model)
    plane = client.createCollisionShape(client.GEOM_PLANE)
    floor = client.createMultiBody(0.0, plane, basePosition=[0.0, 0.0, -FAR])
    points = client.getClosestPoints(number, floor, 2.0 * FAR)
    return min((point[8] for point in points), default=math.inf) - FAR
