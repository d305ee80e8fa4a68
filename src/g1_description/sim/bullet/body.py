"""The PyBullet body behind a tree of a model."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from g1_description.bounds import MAX_VALUE
from g1_description.motion.motors import Motors
from g1_description.robot.assembly import SCOPE
from g1_description.robot.rotation import cross
from g1_description.robot.transform import compose, inverse
from g1_description.sim.bullet.client import BulletClient
from g1_description.sim.bullet.create_body import ROOT, Loaded
from g1_description.sim.model import Model

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
