"""Motions as files that ``read_motion`` reads back to the last bit."""

from __future__ import annotations

import numpy as np

from g1_description.core.motion.trajectory import Trajectory

from .table import BASE, TIME


def table_text(trajectory: Trajectory) -> str:
    """Write a motion as a table with a header.

    Args:
        trajectory: The motion; its velocities are not written.

    Returns:
        The file's text.
    """
    columns = [trajectory.times[:, np.newaxis], trajectory.positions]
    names = [TIME, *trajectory.joint_names]
    if trajectory.base_poses is not None:
        columns.insert(1, trajectory.base_poses)
        names[1:1] = BASE
    rows = np.concatenate(columns, axis=1).tolist()
    lines = [",".join(names), *(",".join(map(repr, row)) for row in rows)]
    return "\n".join(lines) + "\n"
