"""The movable joints of a body in PyBullet, and their motors."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from g1_description.core.bounds import MAX_VALUE
from g1_description.core.motion.motors import Motors
from g1_description.sim.model import Model

from .client import BulletClient

MAX_EFFORT = 1e6
"""Effort limit of a joint whose file gives none, or 0 as exporters do where they know
none, in [N m] or [N]: PyBullet takes no infinity."""


FULL_SHARE = 0.999
"""Share of its effort limit from which on a motor gives all it can: what PyBullet tells
is rounded."""


class BodyJoints:
    """The movable joints of a tree.

    A joint is given by its name or by its row in the model's arrays. PyBullet has a
    number of its own for it, that of the link below.
    """

    def __init__(
        self,
        client: BulletClient,
        body: int,
        model: Model,
        tree: int,
        numbers: Mapping[str, int],
    ) -> None:
        """Disable all motors, also those that PyBullet starts with as friction.

        Args:
            client: PyBullet.
            body: The body's number in PyBullet.
            model: The model whose joints they are.
            tree: Which of the model's trees has them.
            numbers: PyBullet's numbers of the body's links by name.
        """
        self._client, self._body, self._model = client, body, model
        joints = model.assembly.description.trees[tree].movable_joints
        self.rows: np.ndarray = model.trees[tree].joints
        """Which of the model's movable joints they are, shape (n,)."""
        self._numbers = [numbers[joint.child] for joint in joints]
        self._own = {row: own for own, row in enumerate(self.rows.tolist())}
        self._names = [joint.name for joint in joints]
        known = [joint.effort or MAX_EFFORT for joint in joints]
        self.efforts = np.minimum(np.array(known, dtype=float), MAX_EFFORT)
        """What the motors can give at most, in [N m] or [N], shape (n,)."""
        self.set_motors(Motors())
        self._damping = np.array([joint.damping for joint in joints])
        self._friction = np.array([joint.friction for joint in joints])
        self._was_damped = False
        for name in model.ode_joints:
            self.set_properties(name)
        if joints:
            self._drive(np.zeros(len(joints)))

    def __len__(self) -> int:
        """Count them."""
        return len(self._numbers)

    def __contains__(self, name: str) -> bool:
        """Return whether a movable joint is one of them."""
        return self._model.joint_row(name) in self._own

    def set_motors(self, motors: Motors) -> None:
        """Give the joints other motors, whose efforts are not above those there are."""
        own = [motors.of(name) for name in self._names]
        efforts = np.array([motor.effort for motor in own])
        self.efforts = np.minimum(self.efforts, efforts)
        self._position_gains = np.array([motor.position_gain for motor in own])
        self._velocity_gains = np.array([motor.velocity_gain for motor in own])

    def states(self) -> Sequence[tuple]:
        """Read position and velocity, and more, of each."""
        states: Sequence[tuple] = self._client.getJointStates(self._body, self._numbers)
        return states

    def write(self, rows: Iterable[int]) -> None:
        """Write positions and velocities.

        Args:
            rows: Rows of the movable joints in the model; those of other trees are
                skipped.
        """
        position, velocity = self._model.position, self._model.velocity
        for row in rows:
            if row in self._own:
                number = self._numbers[self._own[row]]
                self._client.resetJointState(
                    self._body, number, position[row], velocity[row]
                )

    def hold_position(self, rows: Iterable[int]) -> None:
        """Set the motors to hold joints at the model's targets, within their efforts.

        Args:
            rows: Rows of the movable joints in the model; those of other trees are
                skipped.
        """
        held = np.array([row for row in rows if row in self._own], dtype=int)
        self.follow(held, self._model.target[held], np.zeros(len(held)))

    def follow(
        self, rows: np.ndarray, positions: np.ndarray, velocities: np.ndarray
    ) -> None:
        """Set where the motors want joints, and how fast, within their efforts.

        Args:
            rows: Rows of the movable joints in the model; those of other trees are
                skipped, shape (m,).
            positions: In [rad] or [m], shape (m,).
            velocities: In [rad/s] or [m/s], shape (m,).
        """
        own = [self._own.get(row, -1) for row in rows.tolist()]
        if min(own, default=0) < 0:
            is_own = np.array(own) >= 0
            positions, velocities = positions[is_own], velocities[is_own]
            own = [number for number in own if number >= 0]
        if not own:
            return
        self._client.setJointMotorControlArray(
            self._body,
            [self._numbers[number] for number in own],
            self._client.POSITION_CONTROL,
            targetPositions=positions,
            targetVelocities=velocities,
            forces=self.efforts[own],
            positionGains=self._position_gains[own],
            velocityGains=self._velocity_gains[own],
        )

    def at_effort_limit(self) -> np.ndarray:
        """Find which motors gave all they can in the last step, shape (n,)."""
        has_limit = (self.efforts > 0.0) & (self.efforts < MAX_EFFORT)
        return has_limit & (np.abs(self.applied_efforts()) >= FULL_SHARE * self.efforts)

    def unknown_limits(self) -> list[str]:
        """Name the joints whose file gives an effort of 0, and nothing else a limit."""
        joints = self._model.assembly.description.movable_joints
        unknown = {joint.name for joint in joints if joint.effort == 0.0}
        without = zip(self._names, self.efforts >= MAX_EFFORT)
        return [name for name, is_free in without if is_free and name in unknown]

    def applied_efforts(self) -> np.ndarray:
        """Read what motors applied in the last step, in [N m] or [N], shape (n,)."""
        return np.array([state[3] for state in self.states()])

    def apply_effort(self, name: str, effort: float) -> None:
        """Apply an effort for the next step.

        Args:
            name: The joint's name.
            effort: In [N m] or [N].
        """
        number = self._numbers[self._own[self._model.joint_row(name)]]
        torque = self._client.TORQUE_CONTROL
        self._client.setJointMotorControl2(self._body, number, torque, force=effort)

    def apply_damping(self) -> None:
        """Apply friction and damping of the joints for the next step.

        Motors that want to stand still, none stronger than what slows its joint:
        PyBullet's own damping overshoots where it is strong for the step, and it
        has no friction. Joints that are held need neither.
        """
        is_damped = bool(self._damping.any() or self._friction.any())
        if is_damped or self._was_damped:  # a motor keeps its force until the next one
            speed = np.abs(self._model.velocity[self.rows])
            self._drive(self._friction + self._damping * speed)
        self._was_damped = is_damped

    def _drive(self, efforts: np.ndarray) -> None:
        """Set the motors to stop the joints, by efforts in [N m] or [N], shape (n,)."""
        self._client.setJointMotorControlArray(
            self._body, self._numbers, self._client.VELOCITY_CONTROL, forces=efforts
        )

    def set_properties(self, name: str) -> None:
        """Write those of ODE's numbers of a joint that PyBullet knows too.

        Args:
            name: One of the model's ``ode_joints``; those of other trees are skipped.
        """
        if name not in self:
            return
        row, numbers = self._model.joint_row(name), self._model.ode_joints[name]
        if "damping" in numbers:
            self._damping[self._own[row]] = numbers["damping"]
        if "loStop" in numbers or "hiStop" in numbers:  # PyBullet wants both
            lower = float(self._model.lower[row])
            upper = float(self._model.upper[row])
            self._client.changeDynamics(
                self._body,
                self._numbers[self._own[row]],
                jointLowerLimit=max(numbers.get("loStop", lower), -MAX_VALUE),
                jointUpperLimit=min(numbers.get("hiStop", upper), MAX_VALUE),
            )
