"""Drives of the joints of a model: its motors, or commands of a controller."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from g1_description.motion.motors import Motors, PdMotor, ServoMotor
from g1_description.sim.model import Model

MAX_EFFORT = 1e6
"""Effort limit of a joint without one, or with 0, which exporters write for an unknown
one, in [N m] or [N]: PyBullet does not accept infinity."""


class PdCommand(NamedTuple):
    """A controller's command to some joints; all arrays have the shape (n,).

    The effort is ``effort + stiffness * (position - that of the joint)
    + damping * (velocity - that of the joint)``, up to the motor's limit.
    """

    positions: np.ndarray
    """In [rad] or [m]."""

    velocities: np.ndarray
    """In [rad/s] or [m/s]."""

    stiffness: np.ndarray
    """In [N m/rad] or [N/m]."""

    damping: np.ndarray
    """In [N m s/rad] or [N s/m]."""

    efforts: np.ndarray
    """In [N m] or [N]."""


class Drives:
    """The drives of a model's movable joints, in arrays of shape (n_joints,).

    Joints follow targets with their own motors, or the last ``PdCommand``; without
    motors, as in ``limp``, only commands drive them.
    """

    def __init__(self, model: Model, motors: Motors | None) -> None:
        """Let the motors hold the model's targets.

        Args:
            model: The model.
            motors: Its motors; None: it has none.
        """
        self.motors = motors
        joints = model.assembly.description.movable_joints
        own = [motors.of(joint.name) if motors else PdMotor() for joint in joints]
        servos = [m if isinstance(m, ServoMotor) else ServoMotor() for m in own]
        springs = [m if isinstance(m, PdMotor) else PdMotor() for m in own]
        limits = [
            min(joint.effort or MAX_EFFORT, motor.effort, MAX_EFFORT)
            for joint, motor in zip(joints, own)
        ]
        self.limits = np.array(limits, dtype=float)
        """Largest efforts, in [N m] or [N]."""
        self.position_gains = np.array([motor.position_gain for motor in servos])
        self.velocity_gains = np.array([motor.velocity_gain for motor in servos])
        self.armature = np.array([motor.armature for motor in springs])
        """Inertia of the motors' rotors, in [kg m^2] or [kg]."""
        names = (joint.name for joint in joints)
        self.armature_by_name = dict(zip(names, self.armature.tolist()))
        self.friction = np.array([joint.friction for joint in joints])
        """Friction of joints without a servo, in [N m] or [N]."""
        self.joint_damping = np.array([joint.damping for joint in joints])
        """Damping of joints without a servo, in [N m s/rad] or [N s/m]."""
        self._has_servo = np.array([isinstance(m, ServoMotor) for m in own], dtype=bool)
        self._own_stiffness = np.array([motor.stiffness for motor in springs])
        self._own_damping = np.array([motor.damping for motor in springs])
        self.is_servo = self._has_servo.copy()
        """Which joints are brought to a velocity; the others are springs and dampers,
        or nothing drives them."""
        self.stiffness, self.damping = (
            self._own_stiffness.copy(),
            self._own_damping.copy(),
        )
        self.feedforward = np.zeros(len(joints))
        self._driven = np.zeros(len(joints), dtype=bool)
        self.positions = np.array(model.target, dtype=float)
        self.velocities = np.zeros(len(joints))

    @property
    def is_driven(self) -> bool:
        """Whether a controller drives any joint."""
        return bool(self._driven.any())

    def follow(
        self, rows: np.ndarray, positions: np.ndarray, velocities: np.ndarray
    ) -> None:
        """Let the joints' own motors follow targets.

        Args:
            rows: Rows of the movable joints, shape (n,).
            positions: In [rad] or [m], shape (n,).
            velocities: In [rad/s] or [m/s], shape (n,).
        """
        self.positions[rows], self.velocities[rows] = positions, velocities
        if not self.is_driven:
            return
        self.is_servo[rows] = self._has_servo[rows]
        self.stiffness[rows] = self._own_stiffness[rows]
        self.damping[rows] = self._own_damping[rows]
        self.feedforward[rows] = 0.0
        self._driven[rows] = False

    def obey(self, rows: np.ndarray, command: PdCommand) -> None:
        """Let joints, given by their rows, do as a controller says."""
        self.positions[rows], self.velocities[rows] = command[:2]
        self.stiffness[rows], self.damping[rows] = command[2:4]
        self.feedforward[rows] = command.efforts
        self.is_servo[rows], self._driven[rows] = False, True

    def efforts(self, position: np.ndarray, velocity: np.ndarray) -> np.ndarray:
        """Compute the efforts of springs and dampers, 0 of servos.

        Args:
            position: Position of the movable joints in [rad] or [m], shape (n_joints,).
            velocity: In [rad/s] or [m/s], shape (n_joints,).

        Returns:
            In [N m] or [N], shape (n_joints,).
        """
        efforts = self.feedforward + self.stiffness * (self.positions - position)
        efforts += self.damping * (self.velocities - velocity)
        efforts = np.minimum(np.maximum(efforts, -self.limits), self.limits)
        return np.where(self.is_servo, 0.0, efforts)
