"""The PyBullet body behind a model."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from g1_description.core.errors import LARGEST
from g1_description.core.robot.assembly import SCOPE
from g1_description.core.rotation import cross
from g1_description.core.transform import compose, inverse
from g1_description.sim.model import Model

from .client import BulletClient
from .load import ROOT, links_of

NO_LIMIT = 1e6
"""Effort of a joint without an effort limit, in [N m] or [N]."""

FASTEST = 1000.0
"""No joint or body moves faster, in [m/s] or [rad/s]; PyBullet's own bound is 100."""

FRICTION = 1.0
"""Coefficient of friction where a file gives none: Gazebo's."""


class Body:
    """The body of a tree in PyBullet: the one place that knows PyBullet's frames.

    PyBullet tells and takes the pose and velocity of the root's center of mass,
    along its principal axes; here they are turned to the root link's frame and back.
    """

    def __init__(
        self, client: BulletClient, number: int, model: Model, tree: int = 0
    ) -> None:
        """Take over a loaded body.

        Args:
            client: PyBullet.
            number: The body's number in PyBullet.
            model: The model whose body it is.
            tree: Which of the model's trees it is the body of.
        """
        self._client = client
        self.number = number
        self.model = model
        """The model that it is the body, or a part, of."""
        self.tree = model.trees[tree]
        """What it is the body of."""
        self._tree_number = tree
        description = model.assembly.description.trees[tree]
        self._link_names = dict(links_of(client, number, description))
        self._index = {name: index for index, name in self._link_names.items()}
        joints = description.movable_joints
        self._joints = [self._index[joint.child] for joint in joints]
        self._efforts = [min(joint.effort, NO_LIMIT) for joint in joints]
        inertial = client.getDynamicsInfo(number, ROOT)[3:5]
        self._T_root_center = np.concatenate(inertial)
        self.T_center_root = inverse(self._T_root_center)
        """Pose of the root link on its principal axes, shape (7,)."""
        self._damping = np.array([joint.damping for joint in joints])
        self._friction = np.array([joint.friction for joint in joints])
        self._set_dynamics()
        self.write()
        self._go_limp()

    def _set_dynamics(self) -> None:
        """Set what a URDF file does not tell PyBullet."""
        # ODE takes the lesser of two coefficients, PyBullet their product: with at
        # most 1 on what is static, both are the same on the ground.
        static = self.model.assembly.static
        links = {link.name: link for link in self.model.assembly.description.links}
        for index, name in self._link_names.items():
            shapes = links[name].collisions
            frictions = [s.friction for s in shapes if s.friction is not None]
            restitutions = [s.restitution for s in shapes if s.restitution is not None]
            friction = min(frictions, default=FRICTION)
            self._client.changeDynamics(
                self.number,
                index,
                lateralFriction=min(friction, 1.0) if static else friction,
                restitution=max(restitutions, default=0.0),
                linearDamping=0.0,
                angularDamping=0.0,
                maxJointVelocity=FASTEST,
            )
        self.weigh()
        for name in self.model.ode_joints:
            self.tune(name)

    def weigh(self) -> None:
        """Find the links that gravity does not pull."""
        masses = {
            link.name: link.inertial.mass
            for link in self.model.assembly.description.links
            if link.inertial is not None and not link.has_gravity
        }
        self._weightless = [
            (index, masses[name])
            for index, name in self._link_names.items()
            if name in masses
        ]

    @property
    def moves(self) -> bool:
        """Whether physics can move any of it."""
        return self.is_free or self.has_joints

    @property
    def is_free(self) -> bool:
        """Whether its root moves by itself."""
        return not self.tree.fixed

    @property
    def has_joints(self) -> bool:
        """Whether any of its joints can move."""
        return bool(self._joints)

    def can_move(self, index: int) -> bool:
        """Tell whether physics can move a link, given by PyBullet's number."""
        return self.is_free or (self.has_joints and index != ROOT)

    def link_of(self, index: int) -> str:
        """Name the link behind PyBullet's link number; -1 is the root."""
        return self._link_names[index]

    def has_link(self, name: str) -> bool:
        """Tell whether a link is one of its own."""
        return name in self._index

    def has_joint(self, name: str) -> bool:
        """Tell whether a movable joint is one of its own."""
        return self.model.joint_row(name) in self.tree.joints

    def pass_through(self, other: Body) -> None:
        """Let links not collide with those of another tree of their model.

        As in Gazebo: those of a model inside another one are another model's.
        """
        for index, name in self._link_names.items():
            for theirs, their_name in other._link_names.items():
                if _owner(name) == _owner(their_name):
                    self._client.setCollisionFilterPair(
                        self.number, other.number, index, theirs, 0
                    )

    def write(self) -> None:
        """Give PyBullet the model's state."""
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
        self.write_joints()

    def write_joints(self) -> None:
        """Give PyBullet the positions and velocities of the model's joints."""
        rows, model = self.tree.joints, self.model
        for joint, position, velocity in zip(
            self._joints, model.position[rows], model.velocity[rows]
        ):
            self._client.resetJointState(self.number, joint, position, velocity)

    def joint_states(self) -> Sequence[tuple]:
        """Give what PyBullet knows of its joints: position and velocity, and more."""
        states: Sequence[tuple] = self._client.getJointStates(self.number, self._joints)
        return states

    def push(self, link: str, force: np.ndarray, torque: np.ndarray) -> None:
        """Let a wrench act on a link during the next step.

        Args:
            link: The link's name.
            force: At the link's center of mass, along the world's axes, in [N],
                shape (3,).
            torque: Along the world's axes, in [N m], shape (3,).
        """
        index, world = self._index[link], self._client.WORLD_FRAME
        self._pull(index, force)
        self._client.applyExternalTorque(self.number, index, torque, world)

    def strain(self, joint: str, effort: float) -> None:
        """Let a movable joint's effort act during the next step.

        Args:
            joint: The joint's name.
            effort: In [N m] or [N].
        """
        index = self._joints[self._row(joint)]
        torque = self._client.TORQUE_CONTROL
        self._client.setJointMotorControl2(self.number, index, torque, force=effort)

    def drag(self) -> None:
        """Let friction and damping slow the joints down during the next step.

        Motors that want to stand still, none stronger than what slows its joint:
        PyBullet's own damping overshoots where it is strong for the step, and it
        has no friction. Joints that are held need neither.
        """
        if not (self._joints and (self._damping.any() or self._friction.any())):
            return
        self._client.setJointMotorControlArray(
            self.number,
            self._joints,
            self._client.VELOCITY_CONTROL,
            forces=self._friction
            + self._damping * np.abs(self.model.velocity[self.tree.joints]),
        )

    @property
    def has_weightless(self) -> bool:
        """Whether gravity does not pull one of its links."""
        return bool(self._weightless)

    def float_weightless(self, gravity: tuple[float, float, float]) -> None:
        """Cancel gravity during the next step where a link has none."""
        for index, mass in self._weightless:
            self._pull(index, -mass * np.array(gravity))

    def _pull(self, index: int, force: np.ndarray) -> None:
        """Let a force act at a link's center of mass during the next step."""
        center, world = self._center(index), self._client.WORLD_FRAME
        self._client.applyExternalForce(self.number, index, force, center, world)

    def _center(self, index: int) -> np.ndarray:
        """Find a link's center of mass in the world, in [m], shape (3,)."""
        if index == ROOT:
            pose = self._client.getBasePositionAndOrientation(self.number)
        else:
            pose = self._client.getLinkState(
                self.number, index, computeForwardKinematics=1
            )
        return np.array(pose[0])

    def tune(self, joint: str) -> None:
        """Give PyBullet those of ODE's numbers of a joint that it knows too."""
        if not self.has_joint(joint):
            return
        row, number = self._row(joint), self.model.joint_row(joint)
        numbers = self.model.ode_joints[joint]
        if "damping" in numbers:
            self._damping[row] = numbers["damping"]
        if "loStop" in numbers or "hiStop" in numbers:  # PyBullet wants both
            lower, upper = self.model.lower[number], self.model.upper[number]
            self._client.changeDynamics(
                self.number,
                self._joints[row],
                jointLowerLimit=max(numbers.get("loStop", lower), -LARGEST),
                jointUpperLimit=min(numbers.get("hiStop", upper), LARGEST),
            )

    def _row(self, joint: str) -> int:
        """Tell which of its own movable joints a name means."""
        return int(np.flatnonzero(self.tree.joints == self.model.joint_row(joint))[0])

    def hold(self) -> None:
        """Let motors hold the joints where they were set, within their efforts."""
        if self._joints:
            self._client.setJointMotorControlArray(
                self.number,
                self._joints,
                self._client.POSITION_CONTROL,
                targetPositions=self.model.target[self.tree.joints],
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


def _owner(link: str) -> str:
    """Name the model inside its model that a link belongs to."""
    return link.rpartition(SCOPE)[0]
