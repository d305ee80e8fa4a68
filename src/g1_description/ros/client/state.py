"""States of a robot as arrays, and what several of them make."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from g1_description.core.motion.trajectory import Trajectory
from g1_description.ros.wire.conversions import pose_to_array, twist_to_array
from g1_description.srv import StepModelResponse


@dataclass(frozen=True, eq=False)
class State:
    """Where a robot is at an instant, and how it moves."""

    time_ns: int
    """The stamp, in simulated time, in [ns]."""

    positions: np.ndarray
    """Of the joints in [rad] or [m], in the order of the client's ``joint_names``,
    shape (n_joints,)."""

    velocities: np.ndarray
    """Of the joints in [rad/s] or [m/s], shape (n_joints,)."""

    base: np.ndarray
    """Pose of the root link in the world, shape (7,)."""

    base_twist: np.ndarray
    """Linear velocity of the root link's origin and its angular velocity, along the
    world's axes, in [m/s] and [rad/s], shape (6,)."""

    note: str = ""
    """What was not done as requested, such as positions that were clamped."""

    @property
    def time(self) -> float:
        """The stamp in [s]."""
        return 1e-9 * self.time_ns


def state_of(response: StepModelResponse) -> State:
    """Convert the answer of step_model."""
    joints = response.joint_states
    _, _, note = response.status_message.partition("; ")
    return State(
        joints.header.stamp.to_nsec(),
        np.array(joints.position),
        np.array(joints.velocity),
        pose_to_array(response.base_pose),
        twist_to_array(response.base_twist),
        note,
    )


def trajectory_of(states: Sequence[State], joint_names: Sequence[str]) -> Trajectory:
    """Make a motion of states, whose times count from the first.

    Args:
        states: At rising times.
        joint_names: Of their joints.
    """
    begin = states[0].time_ns
    return Trajectory(
        np.array([1e-9 * (state.time_ns - begin) for state in states]),
        tuple(joint_names),
        np.array([state.positions for state in states]),
        np.array([state.velocities for state in states]),
        np.array([state.base for state in states]),
    )
