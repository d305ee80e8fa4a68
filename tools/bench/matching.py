"""Which joint states answer which link states."""

from __future__ import annotations

import numpy as np
from sensor_msgs.msg import JointState

from .nodes import MeasurementError

AHEAD = 4000  # messages that may be lost in a row
GLANCE = 16  # rows looked at first


def positions_of(bodies, joint_names):
    """Read joint states.

    Args:
        bodies: Messages of one node, which name the same joints.
        joint_names: Joints to read.

    Returns:
        Positions in [rad], shape (n, n_joints).

    Raises:
        MeasurementError: If there is no message, or a joint is not in it.
    """
    if not bodies:
        raise MeasurementError("no joint states came")
    states = [JointState().deserialize(body) for body in bodies]
    missing = set(joint_names) - set(states[0].name)
    if missing:
        raise MeasurementError(f"the joint states lack {', '.join(sorted(missing))}")
    columns = [states[0].name.index(name) for name in joint_names]
    return np.array([state.position for state in states])[:, columns]


def match(sent, came, tolerance):
    """Find which message each answer is for, by what it says.

    Both are in order. An answer may be of any time when it is stamped, as a message
    may have waited; so it is what it tells that counts. Each message is matched
    with one answer at most.

    Args:
        sent: Positions in the messages, shape (n, n_joints).
        came: Positions in the answers, shape (m, n_joints).
        tolerance: Largest difference in [rad].

    Returns:
        Row of ``sent`` for each answer, -1 where there is none, shape (m,).
    """
    rows = np.full(len(came), -1)
    place = 0
    for number, position in enumerate(came):
        row = _next_row(sent, place, position, tolerance)
        if row is not None:
            rows[number], place = row, row + 1
    return rows


def _next_row(sent, place, position, tolerance):
    """Find the next message of these positions; look near first."""
    for begin, end in ((place, place + GLANCE), (place + GLANCE, place + AHEAD)):
        near = np.abs(sent[begin:end] - position).max(axis=1) < tolerance
        if near.any():
            return begin + int(near.argmax())
    return None
