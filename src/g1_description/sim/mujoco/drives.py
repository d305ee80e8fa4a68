"""Motors of MuJoCo's joints: friction that has a target, and springs and dampers."""

from __future__ import annotations

from typing import Any

import numpy as np

from g1_description.sim.drives import Drives

FRICTION_IMPEDANCE = (0.99999, 0.99999, 0.001, 0.5, 2.0)
"""Hardness of friction of joints, and of motors: how exactly they reach a velocity."""

MAX_DAMPING = 10.0
"""Greatest damping of an actuator times the step, relative to the joint's inertia.

It leaves a tenth of the velocity after a step. MuJoCo's constraints see accelerations
without what dampers take within the step: with more, contacts throw the robot away.
"""


WELD_ROWS = 6
"""Constraints of a weld."""


class JointRows:
    """Where the joints of a model, shape (n_joints,), are in MuJoCo's arrays."""

    def __init__(self, model: Any, joints: np.ndarray) -> None:
        self.joints = joints
        self.position = model.jnt_qposadr[joints]
        self.velocity = model.jnt_dofadr[joints]
        ends = {joint: row for row, (joint, _) in enumerate(model.actuator_trnid)}
        self.actuators = np.array([ends[joint] for joint in joints], dtype=int)


class MujocoDrives:
    """The drives of all joints of a world.

    A servo is friction with a target, a spring and damper is an actuator.
    """

    def __init__(self, model: Any, data: Any) -> None:
        self._model, self._data = model, data
        self._qpos, self._qvel = data.qpos, data.qvel
        self._is_servo = np.zeros(model.nv, dtype=bool)
        # Gains, and targets of positions and velocities, by degree of freedom.
        self._gains, self._targets = np.zeros((2, 2, model.nv))
        self._path: np.ndarray | None = None
        # Efforts without springs, stiffness, damping, and limits, by actuator.
        self._springs, self._limits = np.zeros((3, model.nu)), np.zeros(model.nu)
        self._has_springs = False
        joints = model.actuator_trnid[:, 0]
        self._dofs = model.jnt_dofadr[joints]
        self._places = model.jnt_qposadr[joints]
        self._diagonal = model.dof_Madr[self._dofs]
        model.dof_solimp[:] = FRICTION_IMPEDANCE
        self._find_servos()

    def add(self, drives: Drives, rows: JointRows) -> None:
        """Add the motors of a model; ``mj_setConst`` must follow."""
        self._gains[0, rows.velocity] = drives.position_gains
        self._gains[1, rows.velocity] = drives.velocity_gains
        self._model.dof_armature[rows.velocity] = drives.armature
        self._limits[rows.actuators] = drives.limits
        self.update(drives, rows)

    def update(self, drives: Drives, rows: JointRows) -> None:
        """Apply the present drives of a model."""
        model, dofs, is_servo = self._model, rows.velocity, drives.is_servo
        springs = drives.feedforward, drives.stiffness, drives.damping
        self._springs[:, rows.actuators] = springs  # zeros of servos
        self._has_springs = bool(self._springs.any())
        if not self._has_springs:
            model.actuator_biasprm[:] = 0.0
            self._data.ctrl[:] = 0.0
        model.dof_damping[dofs] = np.where(is_servo, 0.0, drives.joint_damping)
        self.set_targets(drives, rows)
        friction = np.where(is_servo, drives.limits, drives.friction)
        is_same = (self._is_servo[dofs] == is_servo).all()
        if is_same and (model.dof_frictionloss[dofs] == friction).all():
            return
        self._is_servo[dofs] = is_servo
        model.dof_frictionloss[dofs] = friction
        self._find_servos()

    def _find_servos(self) -> None:
        """Find the servos among the constraints.

        After those of welds there is one for each joint with friction.
        """
        with_friction = np.flatnonzero(self._model.dof_frictionloss > 0.0)
        servos = np.flatnonzero(self._is_servo[with_friction])
        dofs = with_friction[servos]
        places = self._model.jnt_qposadr[self._model.dof_jntid[dofs]]
        self._has_servos = bool(servos.size)
        if not self._has_servos:
            return
        # Slices, where they can be: numpy takes half as long for them.
        self._servos, self._servo_dofs, self._servo_places = (
            slice(rows[0], rows[-1] + 1) if (np.diff(rows) == 1).all() else rows
            for rows in (WELD_ROWS * self._model.neq + servos, dofs, places)
        )

    def set_targets(self, drives: Drives, rows: JointRows) -> None:
        """Apply the targets of a model."""
        self._targets[:, rows.velocity] = drives.positions, drives.velocities

    @property
    def has_path(self) -> bool:
        """Whether there are targets for each of the next steps."""
        return self._path is not None

    def plan(self, dofs: np.ndarray, path: np.ndarray) -> None:
        """Set targets for each of the next steps.

        Args:
            dofs: Degrees of freedom, shape (n,).
            path: Positions and velocities, shape (2, n_steps, n).
        """
        if self._path is None:
            self._path = np.repeat(self._targets[:, np.newaxis], path.shape[1], axis=1)
        self._path[:, :, dofs] = path

    def prepare(self, count: int, time_step: float) -> None:
        """Prepare the targets of the next steps."""
        path, self._path = self._path, None
        if path is None:
            path = self._targets[:, np.newaxis]
        self._time_step = time_step
        if self._has_servos:
            # The acceleration to the velocity of ``ServoMotor``.
            self._of_state = self._gains[:, self._servo_dofs] / time_step
            self._of_state[0] /= time_step
            goals = self._of_state[:, np.newaxis] * path[..., self._servo_dofs]
            self._of_targets = _for_steps(count, goals[0] + goals[1])
        if self._has_springs:
            pulls = self._springs[1:, np.newaxis] * path[..., self._dofs]
            self._desired = _for_steps(count, pulls[0] + pulls[1])

    def apply(self, step: int) -> None:
        """Drive the joints in one of the prepared steps, between its two halves.

        Friction is a constraint on the acceleration that stops a joint; here, on that
        which brings it to the velocity of ``ServoMotor``, up to the motors' efforts.
        """
        if self._has_servos:
            of_position, of_velocity = self._of_state
            change = (
                self._of_targets[step] - of_position * self._qpos[self._servo_places]
            )
            change -= of_velocity * self._qvel[self._servo_dofs]
            self._data.efc_aref[self._servos] = change
        if self._has_springs:
            self._apply_springs(step)

    def _apply_springs(self, step: int) -> None:
        """Let springs and dampers pull, those at their limits with a constant effort.

        Actuators damp within the step, also where MuJoCo limits their efforts. Here
        those are limited that exceed it even so. Those that damp more than
        ``MAX_DAMPING`` become softer, so that they need the same time as before.
        """
        model, data = self._model, self._data
        inertia = data.qM[self._diagonal]
        ratio = self._springs[2] * self._time_step / inertia
        softness = MAX_DAMPING / np.maximum(ratio, MAX_DAMPING)
        stiffness, damping = self._springs[1:] * softness
        effort = self._springs[0] + self._desired[step] * softness
        now = effort - stiffness * self._qpos[self._places]
        now -= damping * self._qvel[self._dofs]
        damped = now / (1.0 + np.minimum(ratio, MAX_DAMPING))
        is_limited = np.abs(damped) >= self._limits
        data.ctrl[:] = np.where(is_limited, np.copysign(self._limits, now), effort)
        gains = np.where(is_limited, 0.0, [-stiffness, -damping])
        model.actuator_biasprm[:, 1:3] = gains.T


def _for_steps(count: int, rows: np.ndarray) -> np.ndarray:
    """Repeat a row for each step, if there is one for all."""
    return np.repeat(rows, count, axis=0) if len(rows) == 1 else rows
