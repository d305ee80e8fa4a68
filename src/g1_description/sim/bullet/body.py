"""The PyBullet body behind a tree of a model."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from g1_description.core.motion.motors import Motors
from g1_description.core.robot.assembly import SCOPE
from g1_description.core.rotation import cross
from g1_description.core.transform import compose, inverse
from g1_description.sim.model import Model

from .client import BulletClient
from .create_body import ROOT, Loaded
from .joints import BodyJoints

MAX_JOINT_VELOCITY = 1000.0
"""No joint or body moves faster, in [m/s] or [rad/s]; PyBullet's own bound is 100."""

DEFAULT_FRICTION = 1.0
"""Coefficient of friction where a file gives none: Gazebo's."""

MAX_FRICTION = 10.0
"""Largest coefficient of friction: PyBullet's own bound for the product of two."""


class Body:
    """The body of a tree in PyBullet: the one place that knows PyBullet's frames.

    PyBullet reads and writes the pose and velocity of the root's center of mass,
    along its principal axes; here they are turned to the root link's frame and back.
    """

    def __init__(
        self,
        client: BulletClient,
        loaded: Loaded,
        model: Model,
        tree: int = 0,
        motors: Motors | None = None,
    ) -> None:
        """Take over a loaded body, and write the model's state to it.

        Args:
            client: PyBullet.
            loaded: What ``create_body`` made of it.
            model: The model whose body it is.
            tree: Which of the model's trees it is the body of.
            motors: What holds its joints where they were last set; None: nothing.
        """
        self._client = client
        self.number = loaded.number
        """PyBullet's number for it."""
        self.model = model
        """The model that it is the body, or a part, of."""
        self.tree = model.trees[tree]
        """What it is the body of."""
        self._tree_number = tree
        self._holds = motors is not None
        self._link_names = dict(enumerate(loaded.links, ROOT))
        self._index: dict[str, int] = {}
        for index, name in self._link_names.items():
            self._index.setdefault(name, index)  # the next ones only hold shapes
        inertial = client.getDynamicsInfo(self.number, ROOT)[3:5]
        self._T_root_center = np.concatenate(inertial)
        self.T_center_root = inverse(self._T_root_center)
        """Pose of the root link on its principal axes, shape (7,)."""
        self._set_dynamics()
        self.update_gravity()
        self.joints = BodyJoints(client, self.number, model, tree, self._index)
        """Its movable joints."""
        self.write()
        if motors is not None:
            self.joints.set_motors(motors)
            self.joints.hold_position(self.joints.rows)

    def _set_dynamics(self) -> None:
        """Set what PyBullet does not take with the links."""
        # ODE takes the lesser of two coefficients, PyBullet their product: with at
        # most 1 on what is static, both are the same on the ground.
        static = self.model.assembly.static
        for index, name in self._link_names.items():
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
        """Read from the model which links gravity does not pull."""
        links = [(n, self.model.links[name]) for name, n in self._index.items()]
        self._weightless = [
            (index, link.inertial.mass)
            for index, link in links
            if link.inertial is not None and not link.has_gravity
        ]

    @property
    def moves(self) -> bool:
        """Whether physics can move any of it."""
        return self.is_free or len(self.joints) > 0

    @property
    def is_free(self) -> bool:
        """Whether its root moves by itself."""
        return not self.tree.fixed

    @property
    def has_weightless(self) -> bool:
        """Whether gravity does not pull one of its links."""
        return bool(self._weightless)

    def can_move(self, index: int) -> bool:
        """Return whether physics can move a link, given by PyBullet's number."""
        on_root = self._link_names[index] == self._link_names[ROOT]
        return self.is_free or (len(self.joints) > 0 and not on_root)

    def link_name(self, index: int) -> str:
        """Return the name of a link, given by PyBullet's number."""
        return self._link_names[index]

    def has_link(self, name: str) -> bool:
        """Return whether a link is one of its own."""
        return name in self._index

    def pass_through(self, other: Body) -> None:
        """Disable collisions with links of another tree of the same model.

        As in Gazebo: those of a model inside another one are another model's.
        """
        for index, name in self._link_names.items():
            for theirs, their_name in other._link_names.items():
                if _owner(name) == _owner(their_name):
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
        self.joints.write(self.joints.rows.tolist())

    def write_joints(self, rows: Iterable[int]) -> None:
        """Write positions and velocities of joints, and what their motors hold.

        Args:
            rows: Rows of the movable joints in the model; those of other trees are
                skipped.
        """
        self.joints.write(rows)
        if self._holds:
            self.joints.hold_position(rows)

    def apply_wrench(self, link: str, force: np.ndarray, torque: np.ndarray) -> None:
        """Apply a wrench to a link for the next step.

        Args:
            link: The link's name.
            force: At the link's center of mass, along the world's axes, in [N],
                shape (3,).
            torque: Along the world's axes, in [N m], shape (3,).
        """
        index, world = self._index[link], self._client.WORLD_FRAME
        self._apply_force(index, force)
        self._client.applyExternalTorque(self.number, index, torque, world)

    def compensate_gravity(self, gravity: tuple[float, float, float]) -> None:
        """Cancel gravity, in [m/s^2], for the next step on the links without it."""
        for index, mass in self._weightless:
            self._apply_force(index, -mass * np.array(gravity))

    def _apply_force(self, index: int, force: np.ndarray) -> None:
        """Apply a force at a link's center of mass for the next step."""
        center, world = self._center(index), self._client.WORLD_FRAME
        self._client.applyExternalForce(self.number, index, force, center, world)

    def _center(self, index: int) -> np.ndarray:
        """Read a link's center of mass in the world, in [m], shape (3,)."""
        if index == ROOT:
            pose = self._client.getBasePositionAndOrientation(self.number)
        else:
            pose = self._client.getLinkState(
                self.number, index, computeForwardKinematics=1
            )
        return np.array(pose[0])


def _owner(link: str) -> str:
    """Return the name of the model inside its model that a link belongs to."""
    return link.rpartition(SCOPE)[0]
