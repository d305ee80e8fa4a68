"""PyBullet behind the world: a body for each tree of the models that have links."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import chain, combinations

import numpy as np

from g1_description.errors import UnknownNameError
from g1_description.motion.motors import G1_MOTORS, Motor, Motors
from g1_description.robot.launch_arguments import PHYSICS
from g1_description.sim.bullet.body import MAX_EFFORT, Body
from g1_description.sim.bullet.client import BulletClient, connect
from g1_description.sim.bullet.contacts import DepenetrationLimiter, find_contacts
from g1_description.sim.bullet.create_body import TooManyLinksError, create_body
from g1_description.sim.bullet.moving_models import MovingModels
from g1_description.sim.meshes.shapes import find_meshes
from g1_description.sim.model import Model
from g1_description.sim.physics import PhysicsProperties
from g1_description.text import listed

REST_SPEED = 1e-5
"""Greatest speed of a joint or root that counts as standing still, in [m/s] or [rad/s]:
above the noise of the solver in a stack of boxes, far below what can be seen."""

REST_TIME = 0.1
"""How long everything must stand still before the world rests, in [s] of simulated
time: a pendulum that turns round is slower than REST_SPEED for less."""


class RestDetector:
    """Counts for how long everything has stood still."""

    def __init__(self) -> None:
        self._still_for = 0.0
        self._first_speed = 0.0

    @property
    def is_resting(self) -> bool:
        """Whether steps change nothing until something is written."""
        return self._still_for >= REST_TIME

    def wake(self) -> None:
        """Compute again, and count from zero."""
        self._still_for = 0.0

    def update(self, speed: float, time_step: float) -> None:
        """Count a step that was computed.

        What became faster is about to move, however slow it is, such as a pole that
        begins to topple: then the world does not rest.

        Args:
            speed: Greatest speed after the step, in [m/s] or [rad/s].
            time_step: Length of the step in [s].
        """
        if not speed <= REST_SPEED:  # also where it is NaN
            self.wake()
            return
        if self._still_for == 0.0:
            self._first_speed = speed
        self._still_for += time_step
        if self.is_resting and speed > self._first_speed:
            self.wake()


class Engine:
    """Steps the bodies, and gives their models the new states.

    In ``kinematic`` physics nothing moves by itself: the bodies are there for
    contacts only. In the others, a world in which all stands still rests: steps
    change nothing and cost nothing until something is written.
    """

    def __init__(
        self,
        physics: str,
        properties: PhysicsProperties,
        motors: Motors | None = None,
    ) -> None:
        """Start without bodies.

        Args:
            physics: One of ``PHYSICS``.
            properties: The physics' numbers.
            motors: What drives joints in ``hold`` physics; None: motors as strong as
                the robots' files say.

        Raises:
            UnknownNameError: If there is no such physics.
        """
        if physics not in PHYSICS:
            raise UnknownNameError(
                f"There is no physics '{physics}'; there are {', '.join(PHYSICS)}."
            )
        self.physics = physics
        self.properties = properties
        self._motors = (motors or Motors()) if physics == "hold" else None
        self._client = connect()
        self._bodies: dict[str, tuple[Body, ...]] = {}
        self._moved: dict[str, Model] = {}
        self._rest = RestDetector()
        self._begin()

    def _begin(self) -> None:
        """Prepare PyBullet while it has no bodies."""
        self._bodies.clear()
        self._depenetration = DepenetrationLimiter(self._client)
        _write_properties(self._client, self.properties)
        self._is_sorted = False

    def close(self) -> None:
        """Disconnect from PyBullet."""
        self._client.disconnect()

    @property
    def is_dynamic(self) -> bool:
        """Whether things move by themselves."""
        return self.physics != "kinematic"

    def set_properties(self, properties: PhysicsProperties) -> None:
        """Compute with other numbers from now on."""
        self._rest.wake()
        self._depenetration.expect_overlaps()
        self.properties = properties
        _write_properties(self._client, properties)

    def bodies(self, model: Model) -> tuple[Body, ...]:
        """Return a model's bodies for changes to them; the world rests no longer."""
        self._rest.wake()
        return self._bodies.get(model.name, ())

    def write(self, model: Model) -> None:
        """Write a model's pose, joints and velocities to its bodies."""
        if self._is_noted(model):
            return
        self._depenetration.expect_overlaps()
        for body in self.bodies(model):
            body.write()

    def write_joints(self, model: Model, rows: Iterable[int]) -> None:
        """Write some of a model's movable joints to its bodies."""
        if self._is_noted(model):
            return
        self._depenetration.expect_overlaps()
        for body in self.bodies(model):
            body.write_joints(rows)

    def _is_noted(self, model: Model) -> bool:
        """Note that a model is elsewhere, where that is enough.

        In ``kinematic`` physics its bodies are there for contacts only, and follow
        where these are read.
        """
        if not self.is_dynamic:
            self._moved[model.name] = model
        return not self.is_dynamic

    def add(self, model: Model) -> tuple[str, ...]:
        """Make the bodies of a model; if that fails, nothing is changed.

        Args:
            model: The model, in the state its bodies shall have.

        Returns:
            A message for each thing that was left out.

        Raises:
            DescriptionError: If it cannot be loaded.
        """
        if not model.link_names:
            return ()
        before = self._client.getNumBodies()
        try:
            self._bodies[model.name], left_out = self._load(model)
        except BaseException:
            for index in reversed(range(before, self._client.getNumBodies())):
                self._client.removeBody(self._client.getBodyUniqueId(index))
            raise
        self._is_sorted = False
        self._rest.wake()
        self._depenetration.expect_overlaps()
        return left_out

    def _load(self, model: Model) -> tuple[tuple[Body, ...], tuple[str, ...]]:
        """Load all trees of a model; links of one model pass through each other."""
        bodies: list[Body] = []
        meshes, left_out = find_meshes(
            s for link in model.assembly.description.links for s in link.collisions
        )
        motors, remarks = self._motors_of(model)
        for tree in range(len(model.trees)):
            try:
                loaded = create_body(self._client, model, meshes, tree)
            except TooManyLinksError as error:
                if self.is_dynamic:
                    raise
                left_out += (f"its contacts are not found: {error}",)
                continue
            model.hull_deviations.update(loaded.deviations)
            bodies.append(Body(self._client, loaded, model, tree, motors))
        for first, second in combinations(bodies, 2):
            first.pass_through(second)
        unknown = [name for body in bodies for name in body.joints.unknown_limits()]
        if motors and unknown:
            left_out += (
                f"the effort limit of {listed(unknown)} is 0, which is taken as "
                "unknown: the motors have no limit in physics",
            )
        return tuple(bodies), left_out + remarks

    def _motors_of(self, model: Model) -> tuple[Motors | None, tuple[str, ...]]:
        """Choose what drives a model; say so where motors would fit its names only."""
        robot, motors = model.assembly.description, self._motors
        if motors is None or motors.are_for(robot.name):
            return motors, ()
        names = [joint.name for joint in robot.movable_joints]
        if all(motors.of(name) == Motor() for name in names):
            return Motors(), ()
        return Motors(), (
            f"{G1_MOTORS} is not applied: 'g1' is not a word of the robot's name "
            f"'{robot.name}'. Effort limits are those of its URDF; motors:=FILE sets "
            "others.",
        )

    def remove(self, name: str) -> None:
        """Remove a model's bodies, if it has any."""
        self._moved.pop(name, None)
        self._rest.wake()
        self._remove(self._bodies.pop(name, ()))

    def replace(self, model: Model) -> None:
        """Make the bodies of a model again; if that fails, the old ones stay.

        Raises:
            DescriptionError: If it cannot be loaded.
        """
        old = self._bodies.get(model.name, ())
        self.add(model)
        self._remove(old)

    def _remove(self, bodies: Iterable[Body]) -> None:
        """Remove bodies."""
        for body in bodies:
            self._client.removeBody(body.number)
            self._depenetration.forget(body.number)
        self._is_sorted = False

    def rebuild(self, models: Iterable[Model]) -> None:
        """Build everything again: PyBullet's solver remembers contacts.

        Args:
            models: All models, in the state their bodies shall have.
        """
        self._client.resetSimulation()
        self._moved.clear()
        self._begin()
        for model in models:
            self.add(model)

    def update_gravity(self, model: Model) -> None:
        """Read which links of a model gravity pulls."""
        for body in self.bodies(model):
            body.update_gravity()
        self._is_sorted = False

    def step(self) -> None:
        """Compute one time step; the models have their new states after an update."""
        if self._rest.is_resting:
            return
        self._sort()
        for body in self._weightless:
            body.compensate_gravity(self.properties.gravity)
        if self.physics == "limp":
            for body in self._jointed:
                body.joints.apply_damping()
        self._depenetration.apply(self._by_number, self.properties)
        self._client.stepSimulation()
        self._moving.read()

    def update_models(self) -> None:
        """Give the models the states that the step before has computed."""
        if self._rest.is_resting:
            return
        self._moving.update_models()
        self._rest.update(self._moving.speed, self.properties.time_step)
        if self._rest.is_resting:
            self._moving.stop()

    def _sort(self) -> None:
        """Sort the bodies by what a step does with them, where they have changed."""
        if self._is_sorted:
            return
        models = self._bodies.values()
        moving = [bodies for bodies in models if any(body.moves for body in bodies)]
        self._moving = MovingModels(self._client, moving)
        bodies = list(chain.from_iterable(models))
        self._by_number = {body.number: body for body in bodies}
        self._jointed = [body for body in bodies if len(body.joints)]
        self._weightless = [body for body in bodies if body.has_weightless]
        self._is_sorted = True

    def at_effort_limit(self, model: Model) -> np.ndarray:
        """Find where motors gave all they can in the last step, shape (n_joints,)."""
        found = np.zeros(len(model.joint_names), dtype=bool)
        for body in self._bodies.get(model.name, ()):
            if len(body.joints):
                found[body.joints.rows] = body.joints.at_effort_limit()
        return found

    def efforts(self, model: Model) -> np.ndarray:
        """Read what motors applied in the last step, in [N m] or [N].

        Zeros before the first one, shape (n_joints,).
        """
        found = np.zeros(len(model.joint_names))
        for body in self._bodies.get(model.name, ()):
            if len(body.joints):
                found[body.joints.rows] = body.joints.applied_efforts()
        return found

    def effort_limits(self, model: Model) -> np.ndarray:
        """Return what motors can give at most, in [N m] or [N], shape (n_joints,).

        Infinite where neither the robot's file nor that of the motors has a limit.
        """
        found = np.full(len(model.joint_names), np.inf)
        for body in self._bodies.get(model.name, ()):
            is_bounded = body.joints.efforts < MAX_EFFORT
            found[body.joints.rows[is_bounded]] = body.joints.efforts[is_bounded]
        return found

    def contacts(self) -> set[tuple[str, str]]:
        """Find which links touch or overlap now, as ``contacts.find_contacts``."""
        self._write_moved()
        self._sort()
        return find_contacts(self._client, self._by_number)

    def _write_moved(self) -> None:
        """Write models that were noted to their bodies."""
        for model in self._moved.values():
            for body in self.bodies(model):
                body.write()
        self._moved.clear()


def _write_properties(client: BulletClient, properties: PhysicsProperties) -> None:
    """Write the numbers that PyBullet knows."""
    if properties.step_ns:
        client.setTimeStep(properties.time_step)
    client.setGravity(*properties.gravity)
    client.setPhysicsEngineParameter(
        numSolverIterations=max(1, properties.sor_pgs_iters),
        erp=properties.erp,
        contactERP=properties.erp,
        globalCFM=properties.cfm,
        solverResidualThreshold=0.0,  # stopping early lets boxes creep
        deterministicOverlappingPairs=1,
    )
