"""What checks measured of a motion, sample by sample."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from g1_description.checks.balance import Balance
from g1_description.checks.verdict import Verdict, intervals
from g1_description.motion.trajectory import Trajectory
from g1_description.robot.description import Joint


@dataclass(frozen=True, eq=False)
class Timeline:
    """Arrays over the samples that checks looked at; NaN where nothing is known."""

    times: np.ndarray
    """In [s], rising, shape (n,)."""

    joint_names: tuple[str, ...]
    """Joints of the motion."""

    positions: np.ndarray
    """In [rad] or [m], shape (n, n_joints)."""

    velocities: np.ndarray
    """In [rad/s] or [m/s], shape (n, n_joints)."""

    depth: np.ndarray
    """Of the deepest self-collision in [m], zero where there is none, shape (n,); NaN
    where collisions were not looked for."""

    ground_links: tuple[str, ...] = ()
    """Links that are ever low enough to bear, or lower than all others; empty where the
    motion has no base."""

    heights: np.ndarray | None = None
    """Of their lowest points above the floor, in [m], shape (n, n_ground_links);
    infinite for a link that is neither the lowest one nor near the floor."""

    bearing: np.ndarray | None = None
    """Which of them bear, shape (n, n_ground_links)."""

    support: tuple[np.ndarray, ...] = ()
    """Points that bear, along the map's x and y, in [m], shape (k, 2) per sample."""

    balance: Balance | None = None
    """Where the weight acts; None where the motion has no base, or the robot no mass.
    """


@dataclass(frozen=True, eq=False)
class Judged:
    """A verdict, and what it was found from."""

    verdict: Verdict
    timeline: Timeline


def _most(values: np.ndarray) -> float | None:
    """Return the greatest number; None if none is known."""
    return float(np.nanmax(values)) if np.isfinite(values).any() else None


def least(values: np.ndarray) -> float | None:
    """Return the least number; None if none is known."""
    return float(np.nanmin(values)) if np.isfinite(values).any() else None


def figures(
    joints: Sequence[Joint], trajectory: Trajectory, timeline: Timeline
) -> dict[str, float]:
    """Compute the figures of a motion.

    Args:
        joints: Its joints.
        trajectory: The motion: samples are its own.
        timeline: What was measured.
    """
    positions = trajectory.positions
    lower = np.array([joint.lower for joint in joints])
    upper = np.array([joint.upper for joint in joints])
    beyond = ((positions < lower) | (positions > upper)).any(axis=1)
    turns = [joint.kind != "prismatic" for joint in joints]
    speeds = np.abs(timeline.velocities[:, turns])
    found: dict[str, float | None] = {
        "duration": float(timeline.times[-1] - timeline.times[0]),
        "samples": len(trajectory.times),
        "samples_beyond_limits": int(beyond.sum()),
        "largest_joint_speed": float(speeds.max()) if speeds.size else None,
        "deepest_self_collision": _most(timeline.depth),
    }
    if timeline.heights is not None:
        found["lowest_height"] = float(timeline.heights.min())
    if timeline.balance is not None:
        balance = timeline.balance
        found["least_center_margin"] = least(balance.center_margin)
        found["least_zmp_margin"] = least(balance.zmp_margin)
    return {name: value for name, value in found.items() if value is not None}


def bearing(timeline: Timeline) -> dict[str, tuple[tuple[float, float], ...]]:
    """List when links bear."""
    if timeline.bearing is None:
        return {}
    return {
        timeline.ground_links[column]: intervals(
            timeline.times, timeline.bearing[:, column]
        )
        for column in np.flatnonzero(timeline.bearing.any(axis=0))
    }
