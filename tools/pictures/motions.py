"""Motions that the pictures show: a squat, and one with faults."""

from __future__ import annotations

import numpy as np

from g1_description import Robot
from g1_description.motion.motion import Motion
from g1_description.sim.standing import lowest_height

SECONDS = 4.0
RATE = 30
FOOT = "left_ankle_roll_link"
"""It stays where it is."""

FAULTS = (
    (1.0, {"left_shoulder_pitch_joint": 0.45, "left_shoulder_yaw_joint": -0.15}),
    (2.8, {"waist_pitch_joint": 0.3}),
)
"""When what is added to joints, in [s] and [rad]: the left hand then is in the left
leg, the waist beyond its limit."""

LASTING = 0.25
"""How long before and after that half of it is added, in [s]."""


def squat(robot: Robot, with_faults: bool) -> Motion:
    """Make a squat, from a stand and back to it.

    Args:
        robot: The G1.
        with_faults: Whether a hand goes into a leg, and the waist beyond its limit.
    """
    times = np.arange(round(SECONDS * RATE) + 1) / RATE
    stand, low = robot.pose("stand"), robot.pose("squat")
    depth = 0.5 - 0.5 * np.cos(2.0 * np.pi * times / SECONDS)
    bent = stand + depth[:, np.newaxis] * (low - stand)
    for when, angles in FAULTS if with_faults else ():
        share = 0.5 ** ((times - when) / LASTING) ** 2
        for joint, angle in angles.items():
            bent[:, robot.joint_row(joint)] += share * angle
    return robot.trajectory(times, bent, base_poses=_bases(robot, times, bent))


def _bases(robot: Robot, times: np.ndarray, bent: np.ndarray) -> np.ndarray:
    """Place the base upright, such that a foot stays where it is on the floor."""
    foot = robot.forward_kinematics(bent)[:, robot.link_row(FOOT), :3]
    bases = np.tile([0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0], (len(times), 1))
    bases[:, :3] = foot[0] - foot
    begin = robot.trajectory(times[:1], bent[:1], base_poses=bases[:1])
    bases[:, 2] -= lowest_height(robot.description, begin)
    return bases
