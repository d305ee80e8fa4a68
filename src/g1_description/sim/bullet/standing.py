"""How high a robot stands, and how high it hangs clear of the floor."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace

import numpy as np

from g1_description.core.errors import DescriptionError
from g1_description.core.robot.assembly import Assembly
from g1_description.core.robot.reach import origin_reaches
from g1_description.core.rotation import rotate
from g1_description.core.transform import IDENTITY
from g1_description.sim.model import Model

from .body import Body
from .client import BulletClient, connect
from .load import links_of, load_model

GAP = 0.0005
"""Least distance from the floor, in [m]: what touches is pushed away."""

FAR = 1e4
"""Robots are smaller, in [m]."""


def standing_height(assembly: Assembly, rotation: np.ndarray) -> float:
    """Find the height at which a robot stands on the floor, which is z = 0.

    Args:
        assembly: The robot, its joints where they begin.
        rotation: How the model frame is turned in the world, shape (4,).

    Returns:
        The least height of the model frame in whole millimetres, in [m], at which all
        collision shapes are above the floor; without any, all links' origins.

    Raises:
        DescriptionError: If PyBullet refuses the robot.
    """
    pose = np.concatenate([IDENTITY[:3], rotation])
    model = Model("standing", assembly, pose)
    with _loaded(model) as (client, numbers):
        lowest = _lowest_point(client, numbers)
    if math.isinf(lowest):
        lowest = model.poses[:, 2].min(initial=0.0)
    return _above(-lowest)


def hanging_height(assembly: Assembly, rotation: np.ndarray) -> float:
    """Find a height at which no joint can bring a robot to the floor, which is z = 0.

    Args:
        assembly: The robot.
        rotation: How the model frame is turned in the world, shape (4,).

    Returns:
        Height of the model frame in whole millimetres, in [m]. The root link's origin
        is then higher than the farthest that a collision shape, or the origin of a
        link, can be from it, joints anywhere within their limits.

    Raises:
        DescriptionError: If PyBullet refuses the robot, or a joint slides without
            limits.
    """
    model = Model("hanging", replace(assembly, positions={}), IDENTITY)
    description = assembly.description.trees[0]  # only the first one can hang
    reaches = origin_reaches(description)
    with _loaded(model) as (client, numbers):
        reach = max(
            (
                reaches[name] + _extent(client, number, index, pose[:3])
                for number in numbers[:1]
                for index, name, pose in _links(client, number, model)
            ),
            default=0.0,
        )
    if math.isinf(reach):
        raise DescriptionError(
            f"A joint of '{description.name}' slides without limits, no height is out "
            "of its reach: say how high the robot hangs."
        )
    return _above(reach - rotate(rotation, assembly.root_pose[:3])[2])


def _above(height: float) -> float:
    """Give the next whole millimetre above a height, in [m], with a gap between."""
    return math.ceil((height + GAP) * 1000.0) / 1000.0


@contextmanager
def _loaded(model: Model) -> Iterator[tuple[BulletClient, list[int]]]:
    """Load a model into a PyBullet of its own; give that and its bodies' numbers."""
    client = connect()
    try:
        numbers = []
        if model.link_names:
            for tree in range(len(model.trees)):
                number, _ = load_model(client, model, tree)
                Body(client, number, model, tree)
                numbers.append(number)
        yield client, numbers
    finally:
        client.disconnect()


def _links(
    client: BulletClient, number: int, model: Model
) -> Iterator[tuple[int, str, np.ndarray]]:
    """Give the links of the first body: number, name and pose, shape (7,)."""
    poses = dict(zip(model.link_names, model.poses))
    for index, name in links_of(client, number, model.assembly.description.trees[0]):
        if name in poses:  # the world itself has no shapes
            yield index, name, poses[name]


def _extent(client: BulletClient, number: int, link: int, origin: np.ndarray) -> float:
    """Bound how far the shapes of a link are from a point, in [m].

    Args:
        client: PyBullet.
        number: The body.
        link: PyBullet's number of the link.
        origin: The point in the world, shape (3,).

    Returns:
        The distance of the farthest corner of a box around them, which has the axes
        of the world; zero without shapes.
    """
    if not client.getCollisionShapeData(number, link):
        return 0.0
    corners = np.array(client.getAABB(number, link)) - origin
    return float(np.linalg.norm(np.abs(corners).max(axis=0)))


def _lowest_point(client: BulletClient, numbers: list[int]) -> float:
    """Find the height of the lowest point of bodies in [m]; infinite without shapes."""
    plane = client.createCollisionShape(client.GEOM_PLANE)
    floor = client.createMultiBody(0.0, plane, basePosition=[0.0, 0.0, -FAR])
    heights = (
        point[8]
        for number in numbers
        for point in client.getClosestPoints(number, floor, 2.0 * FAR)
    )
    return min(heights, default=math.inf) - FAR
