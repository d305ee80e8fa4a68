"""Polygons that support a robot whose links are held or have poses as targets."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from g1_description.checks.support import Corners, support_polygon
from g1_description.errors import InvalidValueError
from g1_description.ik.tasks import LinkTask
from g1_description.robot.description import Link
from g1_description.robot.rotation import rotate
from g1_description.sim.standing import outlines

SOLE = 0.01
"""Height above the lowest point of all links up to which one stands, in [m]."""

REST = 0.01
"""Speed below which points of a target are at rest on the floor, in [m/s]."""


def found_supports(
    tasks: Sequence[LinkTask],
    links: Sequence[Link],
    times: np.ndarray | None,
    raised: Mapping[int, np.ndarray],
) -> tuple[list[Corners], list[float]]:
    """Find the polygons of the points of links that are at rest on the floor.

    Where there are less than three such points, those that move count, too.

    Args:
        tasks: Poses of links that may stand.
        links: All links, by their rows.
        times: Times of the samples in [s], shape (n_samples,); None: there is only one.
        raised: Whether links stand on something higher than the floor, shape (n,), by
            their rows.

    Returns:
        The polygons and their heights in [m], of each sample or, without links that
        have a pose for each, of all.

    Raises:
        InvalidValueError: If nothing stands.
    """
    parts = [np.zeros((1, 0, 3))]
    soles = [np.zeros((1, 0))]
    for task in tasks:
        outline, radii = outlines(links[task.link])
        poses = task.link_pose.reshape(-1, 1, 7)
        placed = poses[..., :3] + rotate(poses[..., 3:], outline)
        placed[..., 2] -= radii
        parts.append(placed)
        lowest = placed[..., 2].min(axis=1)
        sole = np.where(raised.get(task.link, False), lowest, -np.inf)
        soles.append(np.repeat(sole[:, np.newaxis], len(outline), axis=1))
    count = max(map(len, soles))
    points, heights = (
        np.concatenate(
            [np.broadcast_to(part, (count, *part.shape[1:])) for part in some], axis=1
        )
        for some in (parts, soles)
    )
    floors = points[..., 2].min(axis=1, initial=np.inf)
    rests = is_low = points[..., 2] < np.maximum(floors[:, np.newaxis], heights) + SOLE
    if times is not None and count > 1:
        speeds = np.linalg.norm(np.gradient(points, times, axis=0), axis=-1)
        rests = is_low & (speeds < REST)
    known: dict[bytes, Corners] = {}
    supports = []
    for row in range(count):
        for stands in (rests[row], is_low[row]):
            low = points[row, stands, :2]
            key = low.tobytes()
            corners = known[key] = known.get(key) or support_polygon(low)
            if len(corners) > 2:
                break
        supports.append(corners)
        if len(corners) < 3:
            when = "" if times is None or count == 1 else f" at {times[row]:.2f} s"
            raise InvalidValueError(
                f"Balance needs links that stand on the floor{when}: hold them, or "
                "give the feet of the profile poses as targets."
            )
    return supports, floors.tolist()
