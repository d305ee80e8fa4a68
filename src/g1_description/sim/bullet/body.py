"""The PyBullet body of a tree of a model, with its frames and indices."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

from g1_description.robot.assembly import SCOPE
from g1_description.robot.rotation import cross
from g1_description.robot.transform import compose, inverse
from g1_description.sim.bullet.client import BulletClient
from g1_description.sim.bullet.create_body import ROOT
from g1_description.sim.drives import Drives
from g1_description.sim.model import Model
from g1_description.sim.substance import DEFAULT_FRICTION

MAX_JOINT_VELOCITY = 1000.0
"""Bound of speeds in [m/s] or [rad/s]; PyBullet's default is 100."""

MAX_FRICTION = 10.0
"""Largest coefficient of friction: PyBullet's bound for the product of two."""


class Body:
    """The body of a tree in PyBullet.

    PyBullet reads and writes the pose and velocity of the root's center of mass,
    along its principal axes; here they are turned to the root link's frame and back.
    PyBullet's index of a joint is that of the link below it.
    """

    def __init__(
        self,
        client: BulletClient,
        number: int,
        links: Sequence[str],
        model: Model,
        drives: Drives,
        tree: int = 0,
    ) -> None:
        """Wrap a body of ``create_body``, and write the model's state to it.

        Args:
            client: PyBullet.
            number: PyBullet's number for the body.
            links: Names by PyBullet's numbers for its links from ``ROOT`` on.
            model: The model.
            drives: The drives of the model's joints.
            tree: Index of the tree in the model.
        """
        self._client = client
        self.number = number
        self.model = model
        self.tree = model.trees[tree]
        self._tree_number = tree
        self._drives = drives
        self.link_names = dict(enumerate(links, ROOT))
        """Names of its links by PyBullet's indices."""
        self._index: dict[str, int] = {}
        for index, name in self.link_names.items():
            self._index.setdefault(name, index)  # later ones have only shapes
        inertial = client.getDynamicsInfo(number, ROOT)[3:5]
        self._T_root_center = np.concatenate(inertial)
        self.T_center_root = inverse(self._T_root_center)
        """Pose of the root link on its principal axes, shape (7,)."""
        joints = model.assembly.description.trees[tree].movable_joints
        self.rows: list[int] = self.tree.joints.tolist()
        """Rows of its movable joints in the model."""
        self._own = {row: own for own, row in enumerate(self.rows)}
        self._joints = [self._index[joint.child] for joint in joints]
        self._was_damped = False
        self.applied = np.zeros(len(joints))
        """Efforts of drives without a servo in the last step, in [N m] or [N]."""
        self._set_contacts()
        self.update_gravity()
        if joints:  # PyBullet starts with motors as friction
            self._slow_down(self.rows, np.zeros(len(joints)))
        self.write()
        self.update_drives(np.array(self.rows, dtype=int))

    def _set_contacts(self) -> None:
        """Set friction and restitution, and disable air damping."""
        # ODE uses the lesser of two coefficients, PyBullet their product: with at most
        # 1 on static models, both are equal on the ground.
        static = self.model.assembly.static
        for index, name in self.link_names.items():
            shapes = self.model.links[name].collisions
            frictions = [s.friction for s in shapes if s.friction is not None]
            restitutions = [s.restitution for s in shapes if s.restitution is not None]
            friction = min(frictions, default=DEFAULT_FRICTION)
            self._client.changeDynamics(
                self.number,
                index,
                lateralFriction=min(friction, 1.0 if static else MAX_FRICTION),
                restitution=max(restitutions, default=0.0),
                linearDamping=0.0,
                angularDamping=0.0,
                maxJointVelocity=MAX_JOINT_VELOCITY,
            )

    def update_gravity(self) -> None:
        """Read from the model which links have no gravity."""
        links = [(n, self.model.links[name]) for name, n in self._index.items()]
        self.weightless = [
            (index, link.inertial.mass)
            for index, link in links
            if link.inertial is not None and not link.has_gravity
        ]
        """PyBullet's indices of links without gravity, and their masses in [kg]."""

    @property
    def moves(self) -> bool:
        """Whether physics can move any of it."""
        return not self.tree.fixed or bool(self.rows)

    def can_move(self, index: int) -> bool:
        """Return whether physics can move a link, given by PyBullet's index."""
        on_root = self.link_names[index] == self.link_names[ROOT]
        return not self.tree.fixed or (bool(self.rows) and not on_root)

    def pass_through(self, other: Body) -> None:
        """Disable collisions with links of another tree of the same model.

        As in Gazebo, a nested model counts as another model.
        """
        for index, name in self.link_names.items():
            for theirs, their_name in other.link_names.items():
                if name.rpartition(SCOPE)[0] == their_name.rpartition(SCOPE)[0]:
                    self._client.setCollisionFilterPair(
                        self.number, other.number, index, theirs, 0
                    )

    def write(self) -> None:
        """Write the model's state to PyBullet; motors keep their targets."""
        root_pose = self.model.root_poses[self._tree_number]
        root_twist = self.model.root_twists[self._tree_number]
        T_world_center = compose(root_pose, self._T_root_center)
        self._client.resetBasePositionAndOrientation(
            self.number, T_world_center[:3], T_world_center[3:]
        )
        lever = T_world_center[:3] - root_pose[:3]
        angular = root_twist[3:]
        linear = root_twist[:3] + cross(angular, lever)
        self._client.resetBaseVelocity(self.number, linear, angular)
        self._reset_joints(self.rows)

    def write_joints(self, rows: Iterable[int]) -> None:
        """Write positions and velocities of joints.

        Args:
            rows: Rows of movable joints in the model; those of other trees are
                skipped.
        """
        self._reset_joints(row for row in rows if row in self._own)

    def _reset_joints(self, rows: Iterable[int]) -> None:
        position, velocity = self.model.position, self.model.velocity
        for row in rows:
            number = self._joints[self._own[row]]
            self._client.resetJointState(
                self.number, number, position[row], velocity[row]
            )

    def joint_states(self) -> Sequence[tuple]:
        """Read position, velocity, reaction and effort of each movable joint."""
        states: Sequence[tuple] = self._client.getJointStates(self.number, self._joints)
        return states

    def update_drives(self, rows: np.ndarray) -> None:
        """Apply the drives of joints of the model; those of other trees are skipped."""
        drives = self._drives
        own = [row for row in rows.tolist() if row in self._own]
        servos = [row for row in own if drives.is_servo[row]]
        self._slack = [row for row in self.rows if not drives.is_servo[row]]
        resistance = drives.friction + drives.joint_damping
        self._is_damped = bool(resistance[self._slack].any())
        pulls = (drives.stiffness, drives.damping, drives.feedforward)
        self._is_driven = any(each.any() for each in pulls)
        if len(servos) < len(own):
            loose = [row for row in own if not drives.is_servo[row]]
            self._slow_down(loose, np.zeros(len(loose)))
        if servos:
            self._client.setJointMotorControlArray(
                self.number,
                [self._joints[self._own[row]] for row in servos],
                self._client.POSITION_CONTROL,
                targetPositions=drives.positions[servos],
                targetVelocities=drives.velocities[servos],
                forces=drives.limits[servos],
                positionGains=drives.position_gains[servos],
                velocityGains=drives.velocity_gains[servos],
            )

    def apply_effort(self, row: int, effort: float) -> None:
        """Apply an effort to a joint of the model, if it belongs to this tree."""
        if row in self._own:
            number, torque = self._joints[self._own[row]], self._client.TORQUE_CONTROL
            self._client.setJointMotorControl2(
                self.number, number, torque, force=effort
            )

    def apply_drives(self) -> None:
        """Apply efforts, friction and damping of joints without a servo for a step.

        Friction and damping are motors with a target velocity of zero and these efforts
        as limits: PyBullet's own damping overshoots if it is large for the step, and
        PyBullet has no joint friction.
        """
        slack, drives, model = self._slack, self._drives, self.model
        if not slack:
            return
        if self._is_damped or self._was_damped:  # a motor keeps its force until then
            speed = np.abs(model.velocity[slack])
            efforts = drives.friction[slack] + drives.joint_damping[slack] * speed
            self._slow_down(slack, efforts)
        self._was_damped = self._is_damped
        if not self._is_driven:
            self.applied = np.zeros(len(self.rows))
            return
        self.applied = drives.efforts(model.position, model.velocity)[self.rows]
        for own in np.flatnonzero(self.applied).tolist():
            self.apply_effort(self.rows[own], self.applied[own])

    def _slow_down(self, rows: Sequence[int], efforts: np.ndarray) -> None:
        """Set motors that stop joints by efforts, shape (n,)."""
        joints = [self._joints[self._own[row]] for row in rows]
        self._client.setJointMotorControlArray(
            self.number, joints, self._client.VELOCITY_CONTROL, forces=efforts
        )

    def set_stops(self, row: int, low: float, high: float) -> None:
        """Set the stops of a joint of the model, if it belongs to this tree."""
        if row in self._own:
            self._client.changeDynamics(  # PyBullet needs both
                self.number,
                self._joints[self._own[row]],
                jointLowerLimit=low,
                jointUpperLimit=high,
            )

    def apply_wrench(self, link: str, wrench: np.ndarray) -> None:
        """Apply a wrench to a link, if it belongs to this tree."""
        index, frame = self._index.get(link), self._client.WORLD_FRAME
        if index is not None:
            self._apply_force(index, wrench[:3])
            self._client.applyExternalTorque(self.number, index, wrench[3:], frame)

    def compensate_gravity(self, gravity: Any) -> None:
        """Cancel gravity, in [m/s^2], for the next step on the links without it."""
        for index, mass in self.weightless:
            self._apply_force(index, -mass * np.array(gravity))

    def _apply_force(self, index: int, force: np.ndarray) -> None:
        """Apply a force at a link's center of mass for the next step."""
        if index == ROOT:
            pose = self._client.getBasePositionAndOrientation(self.number)
        else:
            pose = self._client.getLinkState(
                self.number, index, computeForwardKinematics=1
            )
        frame = self._client.WORLD_FRAME
        self._client.applyExternalForce(self.number, index, force, pose[0], frame)
