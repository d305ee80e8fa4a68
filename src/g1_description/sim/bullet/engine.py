"""PyBullet as an engine: a body for each tree of the models that have links."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from itertools import chain, combinations

import numpy as np

from g1_description.errors import DescriptionError
from g1_description.motion.motors import Motors
from g1_description.robot.assembly import SCOPE
from g1_description.robot.rotation import cross
from g1_description.robot.transform import compose
from g1_description.sim.bullet.body import Body
from g1_description.sim.bullet.client import BulletClient, connect
from g1_description.sim.bullet.create_body import (
    MAX_JOINTS,
    TooManyLinksError,
    create_body,
)
from g1_description.sim.bullet.grips import Grips
from g1_description.sim.engine import Engine, PhysicsProperties
from g1_description.sim.grip import Grip
from g1_description.sim.meshes.shapes import find_meshes
from g1_description.sim.model import Model, States
from g1_description.sim.moving_models import MovingModels
from g1_description.text import listed

MAX_DEPENETRATION_SPEED = 0.3
"""Largest speed at which overlapping links separate, in [m/s]. ODE has such a bound per
contact, Gazebo's ``max_vel`` of 0.01 m/s, which is slow to watch; an object thrown at
this speed rises by 5 mm."""

CONTACT_HARDNESS = 1e9
"""Stiffness times the time step, plus damping, of links with their own ``erp``: large
enough that their contacts are as hard as others."""


class DepenetrationLimiter:
    """Bounds the speed at which contacts push overlapping links apart.

    In each step PyBullet corrects the fraction ``erp`` of an overlap, by a velocity
    that bodies keep. It has no bound for it, but contact stiffness and damping set a
    fraction per link: deep links get a smaller one.
    """

    def __init__(self, client: BulletClient) -> None:
        self._client = client
        self._given: dict[tuple[int, int], tuple[float, float]] = {}
        self._may_overlap = False

    def expect_overlaps(self) -> None:
        """Record that a change may have caused an overlap."""
        self._may_overlap = True

    def forget(self, body: int) -> None:
        """Forget a removed body, by its number in PyBullet."""
        self._given = {key: erp for key, erp in self._given.items() if key[0] != body}

    def apply(self, bodies: Mapping[int, Body], properties: PhysicsProperties) -> None:
        """Set each link's ``erp`` for the next step.

        Args:
            bodies: All bodies by their numbers in PyBullet.
            properties: The physics properties.
        """
        if not (self._may_overlap and properties.step_ns):
            return
        time_step = properties.time_step
        distance = MAX_DEPENETRATION_SPEED * time_step
        deepest = self._deep_links(bodies, properties.erp, distance)
        for key in {**self._given, **deepest}:
            erp = distance / deepest[key] if key in deepest else properties.erp
            if self._given.get(key) != (erp, time_step):
                self._client.changeDynamics(
                    *key,
                    contactStiffness=erp * CONTACT_HARDNESS / time_step,
                    contactDamping=(1.0 - erp) * CONTACT_HARDNESS,
                )
                self._given[key] = erp, time_step
        self._may_overlap = bool(deepest)

    def _deep_links(
        self, bodies: Mapping[int, Body], erp: float, distance: float
    ) -> dict[tuple[int, int], float]:
        """Find the links that PyBullet would push by more than a distance in a step.

        Returns:
            The largest depth in [m] by PyBullet's numbers of body and link, assigned to
            the first movable link of each pair.
        """
        self._client.performCollisionDetection()
        deepest: dict[tuple[int, int], float] = {}
        for point in self._client.getContactPoints() or ():
            depth = -point[8]
            if erp * depth <= distance:
                continue
            for body, link in ((point[1], point[3]), (point[2], point[4])):
                if bodies[body].can_move(link):
                    deepest[body, link] = max(depth, deepest.get((body, link), 0.0))
                    break
        return deepest


class BulletEngine(Engine):
    """PyBullet behind a world.

    In ``kinematic`` physics bodies follow their models only when contacts are
    requested.
    """

    def __init__(
        self,
        physics: str,
        properties: PhysicsProperties,
        motors: Motors | str | None = None,
    ) -> None:
        super().__init__(physics, properties, motors)
        self._client = connect()
        self._bodies: dict[str, tuple[Body, ...]] = {}
        self._moved: dict[str, Model] = {}
        self._begin()

    def _begin(self) -> None:
        """Prepare PyBullet while it has no bodies."""
        self._bodies.clear()
        self._moved.clear()
        self._depenetration = DepenetrationLimiter(self._client)
        self._held = Grips(self._client)
        self._write_properties()
        self._is_sorted = False

    def close(self) -> None:
        """Disconnect from PyBullet."""
        self._client.disconnect()

    def set_properties(self, properties: PhysicsProperties) -> None:
        """Set the properties; PyBullet uses some of them."""
        self._rest.wake()
        self._depenetration.expect_overlaps()
        self.properties = properties
        self._write_properties()

    def _write_properties(self) -> None:
        properties = self.properties
        if properties.step_ns:
            self._client.setTimeStep(properties.time_step)
        self._client.setGravity(*properties.gravity)
        self._client.setPhysicsEngineParameter(
            numSolverIterations=max(1, properties.sor_pgs_iters),
            erp=properties.erp,
            contactERP=properties.erp,
            globalCFM=properties.cfm,
            solverResidualThreshold=0.0,  # stopping early lets boxes creep
            deterministicOverlappingPairs=1,
        )

    def _woken(self, model: Model) -> tuple[Body, ...]:
        """Wake the world, and return a model's bodies for a change."""
        self._rest.wake()
        return self._bodies.get(model.name, ())

    def write(self, model: Model) -> None:
        """Write roots and joints to the bodies; deferred in kinematic physics."""
        if not self.is_dynamic:
            self._moved[model.name] = model
            return
        self._depenetration.expect_overlaps()
        for body in self._woken(model):
            body.write()

    def write_joints(self, model: Model, rows: Iterable[int]) -> None:
        """Write some joints to the bodies; deferred in kinematic physics."""
        if not self.is_dynamic:
            self._moved[model.name] = model
            return
        self._depenetration.expect_overlaps()
        for body in self._woken(model):
            body.write_joints(rows)

    def _update_drives(self, model: Model, rows: np.ndarray) -> None:
        """Apply the drives of some joints."""
        for body in self._woken(model):
            body.update_drives(rows)

    def apply_wrench(self, model: Model, link: str, wrench: np.ndarray) -> None:
        """Apply a wrench to a link in the next step."""
        for body in self._woken(model):
            body.apply_wrench(link, wrench)

    def apply_effort(self, model: Model, row: int, effort: float) -> None:
        """Apply an effort to a joint in the next step."""
        for body in self._woken(model):
            body.apply_effort(row, effort)

    def _set_stops(self, model: Model, row: int, low: float, high: float) -> None:
        """Set the stops of a joint."""
        for body in self._woken(model):
            body.set_stops(row, low, high)

    def _add(self, model: Model) -> tuple[str, ...]:
        """Make the bodies of a model, unless they are too large for PyBullet."""
        joints = max(len(tree.joints) for tree in model.trees)
        if self.is_dynamic and joints > MAX_JOINTS:
            name = model.assembly.description.name
            raise DescriptionError(
                f"Robot '{name}' has {joints} movable joints; more than {MAX_JOINTS} "
                "need kinematic physics."
            )
        left_out, armature = self._make(model), self._drives[model.name].armature
        movable = model.assembly.description.movable_joints
        sliding = [
            joint.name
            for joint, inertia in zip(movable, armature)
            if joint.kind == "prismatic" and inertia
        ]
        if sliding:
            left_out += (
                f"the armature of {listed(sliding)} is ignored: with PyBullet only "
                "joints that turn have one",
            )
        return left_out

    def _make(self, model: Model) -> tuple[str, ...]:
        """Make the bodies of a model; if that fails, nothing is changed."""
        before = self._client.getNumBodies()
        try:
            self._bodies[model.name], left_out = self._load(model)
        except BaseException:
            for index in reversed(range(before, self._client.getNumBodies())):
                self._client.removeBody(self._client.getBodyUniqueId(index))
            raise
        for name in model.ode_joints:
            self.update_joint(model, name)
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
        drives = self._drives[model.name]
        for tree in range(len(model.trees)):
            try:
                number, links = create_body(self._client, model, drives, meshes, tree)
            except TooManyLinksError as error:
                if self.is_dynamic:
                    raise
                left_out += (f"its contacts are not computed: {error}",)
                continue
            bodies.append(Body(self._client, number, links, model, drives, tree))
        for first, second in combinations(bodies, 2):
            first.pass_through(second)
        return tuple(bodies), left_out

    def remove(self, name: str) -> None:
        """Remove a model's bodies, if it has any."""
        self._moved.pop(name, None)
        self._drives.pop(name, None)
        self._rest.wake()
        self._remove(self._bodies.pop(name, ()))

    def replace(self, model: Model) -> None:
        """Make the bodies of a model again; if that fails, the old ones stay.

        Raises:
            DescriptionError: If it cannot be loaded.
        """
        old = self._bodies.get(model.name, ())
        self._make(model)
        self._remove(old)

    def fix(self, grips: Sequence[Grip]) -> None:
        """Fix objects to links, before the next step."""
        super().fix(grips)
        self._held.release()
        self._is_sorted = False

    def _remove(self, bodies: Iterable[Body]) -> None:
        """Remove bodies."""
        self._held.release()
        for body in bodies:
            self._client.removeBody(body.number)
            self._depenetration.forget(body.number)
        self._is_sorted = False

    def _rebuild(self, models: Sequence[Model]) -> None:
        """Build everything again, as PyBullet's solver remembers contacts."""
        self._client.resetSimulation()
        self._begin()
        for model in models:
            self._make(model)

    def update_gravity(self, model: Model) -> None:
        """Apply which links of a model have gravity."""
        for body in self._woken(model):
            body.update_gravity()
        self._is_sorted = False

    def _advance(self, count: int) -> None:
        """Compute one time step."""
        self._sort()
        for body in self._weightless:
            body.compensate_gravity(self.properties.gravity)
        for body in self._jointed:
            body.apply_drives()
        self._depenetration.apply(self._by_number, self.properties)
        self._client.stepSimulation()

    def _sort(self) -> None:
        """Sort the bodies for a step, if they have changed."""
        if self._is_sorted:
            return
        models = self._bodies.values()
        moving = [bodies for bodies in models if any(body.moves for body in bodies)]
        self._moving = _moving_models(self._client, moving)
        bodies = list(chain.from_iterable(models))
        self._by_number = {body.number: body for body in bodies}
        self._jointed = [body for body in bodies if body.rows]
        self._weightless = [body for body in bodies if body.weightless]
        self._held.release()
        self._held.fix(self._grips, self._bodies)
        self._is_sorted = True

    def efforts(self, model: Model) -> np.ndarray:
        """Read the efforts of motors in the last step."""
        found = np.zeros(len(model.joint_names))
        for body in self._bodies.get(model.name, ()):
            if body.rows:
                by_servos = [state[3] for state in body.joint_states()]
                is_servo = self._drives[model.name].is_servo[body.rows]
                found[body.rows] = np.where(is_servo, by_servos, body.applied)
        return found

    def contacts(self) -> set[tuple[str, str]]:
        """Find the pairs of links that touch or overlap now."""
        self._write_moved()
        self._sort()
        self._client.performCollisionDetection()
        bodies, pairs = self._by_number, set()
        for point in self._client.getContactPoints() or ():
            links = [(bodies[point[1]], point[3]), (bodies[point[2]], point[4])]
            if point[8] <= 0.0 and any(body.can_move(link) for body, link in links):
                first, second = sorted(
                    f"{body.model.name}{SCOPE}{body.link_names[link]}"
                    for body, link in links
                )
                pairs.add((first, second))
        return pairs

    def _write_moved(self) -> None:
        """Write the models that were moved in kinematic physics to their bodies."""
        for model in self._moved.values():
            for body in self._woken(model):
                body.write()
        self._moved.clear()


def _moving_models(
    client: BulletClient, models: Sequence[Sequence[Body]]
) -> MovingModels:
    """Prepare to read the bodies of each model, in the order of its trees."""
    first = [bodies[0].model for bodies in models]
    bodies = list(chain.from_iterable(models))
    free = [row for row, body in enumerate(bodies) if not body.tree.fixed]
    offsets = [bodies[row].T_center_root for row in free]
    T_center_root = np.array(offsets).reshape(-1, 7)
    begins = np.cumsum([0, *(len(model.joint_names) for model in first)])
    jointed = [
        (body, begin + body.tree.joints)
        for own, begin in zip(models, begins)
        for body in own
        if body.rows
    ]
    rows = np.concatenate([np.zeros(0, dtype=int), *(rows for _, rows in jointed)])

    def read() -> tuple[States, States, None]:
        roots = np.concatenate([model.root_poses for model in first])
        root_twists = np.zeros((len(roots), 6))
        if free:
            numbers = [bodies[row].number for row in free]
            pose_of = client.getBasePositionAndOrientation
            centers = np.array([sum(pose_of(n), ()) for n in numbers])
            twists = np.array([sum(client.getBaseVelocity(n), ()) for n in numbers])
            poses = compose(centers, T_center_root)
            twists[:, :3] += cross(twists[:, 3:], poses[:, :3] - centers[:, :3])
            roots[free], root_twists[free] = poses, twists
        joints = np.zeros((len(rows), 2))
        joints[rows] = [
            state[:2] for body, _ in jointed for state in body.joint_states()
        ] or np.zeros((0, 2))
        position, velocity = joints.T
        return (roots, root_twists), (position, velocity), None

    return MovingModels(first, read)
