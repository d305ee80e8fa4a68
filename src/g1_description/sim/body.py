"""The PyBullet body behind a model."""

from __future__ import annotations

import numpy as np
from pybullet_utils.bullet_client import BulletClient

from ..core.transform import compose, inverse
from .model import Model

NO_LIMIT = 1e6
"""Effort of a joint without an effort limit, in [N m] or [N]."""

_FRICTION = 1.0


class Body:
    """A model's body in PyBullet: the one place that knows PyBullet's frames.

    PyBullet tells and takes the pose and velocity of the root's center of mass,
    along its principal axes; here they are turned to the root link's frame and back.
    """

    def __init__(self, client: BulletClient, number: int, model: Model) -> None:
        """Take over a loaded body.

        Args:
            client: PyBullet.
            number: The body's number in PyBullet.
            model: The model whose body it is.
        """
        self._client = client
        self.number = number
        self._model = model
        place = {
            client.getJointInfo(number, index)[1].decode(): index
            for index in range(client.getNumJoints(number))
        }
        self._joints = [place[name] for name in model.joint_names]
        efforts = [joint.effort for joint in model.lumped.description.joints]
        self._efforts = [min(effort, NO_LIMIT) for effort in efforts]
        inertial = client.getDynamicsInfo(number, -1)[3:5]
        self._T_root_center = np.concatenate(inertial)
        self._T_center_root = inverse(self._T_root_center)
        for link in range(-1, client.getNumJoints(number)):
            client.changeDynamics(
                number,
                link,
                lateralFriction=_FRICTION,
                linearDamping=0.0,
                angularDamping=0.0,
            )
        self.write()
        self._go_limp()

    def link_of(self, index: int) -> str:
        """Name the link behind PyBullet's link number; -1 is the root."""
        if index == -1:
            return self._model.lumped.description.root
        return self._client.getJointInfo(self.number, index)[12].decode()

    def write(self) -> None:
        """Give PyBullet the model's state."""
        model = self._model
        T_world_center = compose(model.root_pose, self._T_root_center)
        self._client.resetBasePositionAndOrientation(
            self.number, T_world_center[:3], T_world_center[3:]
        )
        lever = T_world_center[:3] - model.root_pose[:3]
        angular = model.root_twist[3:]
        linear = model.root_twist[:3] + np.cross(angular, lever)
        self._client.resetBaseVelocity(self.number, linear, angular)
        self.write_joints()

    def write_joints(self) -> None:
        """Give PyBullet the positions and velocities of the model's joints."""
        model = self._model
        for joint, position, velocity in zip(
            self._joints, model.position, model.velocity
        ):
            self._client.resetJointState(self.number, joint, position, velocity)

    def read(self) -> None:
        """Take the model's state from PyBullet."""
        model = self._model
        T_world_center = np.concatenate(
            self._client.getBasePositionAndOrientation(self.number)
        )
        model.root_pose = compose(T_world_center, self._T_center_root)
        linear, angular = (
            np.array(part) for part in self._client.getBaseVelocity(self.number)
        )
        lever = model.root_pose[:3] - T_world_center[:3]
        model.root_twist = np.concatenate([linear + np.cross(angular, lever), angular])
        if self._joints:
            states = self._client.getJointStates(self.number, self._joints)
            model.position = np.array([state[0] for state in states])
            model.velocity = np.array([state[1] for state in states])
        model.update()

    def hold(self) -> None:
        """Let motors hold the joints where they are, within the URDF's efforts."""
        if self._joints:
            self._client.setJointMotorControlArray(
                self.number,
                self._joints,
                self._client.POSITION_CONTROL,
                targetPositions=self._model.position,
                forces=self._efforts,
            )

    def _go_limp(self) -> None:
        """Switch all motors off, also those PyBullet starts with as friction."""
        if self._joints:
            self._client.setJointMotorControlArray(
                self.number,
                self._joints,
                self._client.VELOCITY_CONTROL,
                forces=[0.0] * len(self._joints),
            )
