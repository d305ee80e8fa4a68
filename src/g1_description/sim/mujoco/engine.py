"""MuJoCo as an engine: all models of a world are compiled into one."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import mujoco
import numpy as np

from g1_description.errors import DescriptionError, cause
from g1_description.motion.motors import Motors
from g1_description.robot.assembly import SCOPE
from g1_description.robot.rotation import conjugate, cross, rotate
from g1_description.sim.engine import (
    FAILURE,
    MAX_STEPS,
    Engine,
    PhysicsProperties,
    Steps,
)
from g1_description.sim.grip import Grip
from g1_description.sim.meshes.shapes import Mesh, find_meshes
from g1_description.sim.model import Model
from g1_description.sim.moving_models import REST_SPEED, MovingModels
from g1_description.sim.mujoco.drives import MujocoDrives
from g1_description.sim.mujoco.mjcf import WorldFile
from g1_description.sim.mujoco.reading import ModelRows, Reader, Trace

MAX_DEPENETRATION_SPEED = 0.3
"""Largest speed at which overlapping links separate, in [m/s]."""

IMPEDANCE = (0.99, 0.999, 0.001, 0.5, 2.0)
"""Hardness of contacts and stops, MuJoCo's ``solimp``."""

FRICTION_RATIO = 10.0
"""MuJoCo's ``impratio``: how much harder friction is than contacts, against slip."""

MAX_SPIN = 0.03
"""Largest turn of a free body per step, in [rad], that ``implicitfast`` integrates as
well as ``implicit``, to 3 % in a second. It diverges from three times that on."""

HIT_SPEED = 1.0
"""Speed in [m/s] or [rad/s] below which nothing that hits another thing overlaps it
deeply."""

MAX_SPEED = 1e6
"""Speed in [m/s] or [rad/s] that no robot has: above it, a step has failed."""

mujoco.set_mju_user_warning(lambda text: None)  # else it writes MUJOCO_LOG.TXT


class MujocoEngine(Engine):
    """MuJoCo behind a world.

    The world is compiled again, from the states of its models, for the first step or
    query after models came or went.
    """

    max_steps = MAX_STEPS

    def __init__(
        self,
        physics: str,
        properties: PhysicsProperties,
        motors: Motors | str | None = None,
    ) -> None:
        super().__init__(physics, properties, motors)
        self._models: dict[str, tuple[Model, Mapping[str, Mesh]]] = {}
        self._is_compiled = False
        self._may_overlap = True
        self._trace: Trace | None = None
        self._forces: list[tuple[Model, str, np.ndarray]] = []
        self._joint_efforts: list[tuple[Model, int, float]] = []

    def close(self) -> None:
        """Forget all models."""
        self._models.clear()
        self._is_compiled = False

    # --- the world ---

    def _add(self, model: Model) -> tuple[str, ...]:
        """Add a model; it is compiled alone, to see that it can be."""
        meshes, left_out = find_meshes(
            s for link in model.assembly.description.links for s in link.collisions
        )
        self._include(model, meshes)
        if model.assembly.static and meshes:
            left_out += ("meshes of static models are simulated as their hulls",)
        return left_out

    def _include(self, model: Model, meshes: Mapping[str, Mesh]) -> None:
        """Include a model in the world, if MuJoCo accepts it."""
        file = WorldFile()
        file.add(model, meshes)
        _compiled(file, model.assembly.description.name)
        model.hull_deviations.update(file.deviations)
        self._models[model.name] = model, meshes
        self._is_compiled = False
        self._rest.wake()

    def remove(self, name: str) -> None:
        """Remove a model."""
        self._models.pop(name, None)
        self._drives.pop(name, None)
        self._rest.wake()
        self._is_compiled = False

    def replace(self, model: Model) -> None:
        """Compile a model again, with its current links.

        Raises:
            DescriptionError: If MuJoCo refuses it; the old one stays.
        """
        self._include(model, self._models[model.name][1])

    def fix(self, grips: Sequence[Grip]) -> None:
        """Fix objects to links, before the next step."""
        super().fix(grips)
        self._is_compiled &= not self.is_dynamic

    def _rebuild(self, models: Sequence[Model]) -> None:
        """Compile everything again, as the solver remembers its last solution."""
        known = self._models
        self._models = {m.name: (m, known[m.name][1]) for m in models}
        self._forces.clear()
        self._joint_efforts.clear()
        self._is_compiled = False

    def _compile(self) -> None:
        """Compile the models, if they have changed, and write their states."""
        if self._is_compiled:
            return
        file = WorldFile()
        for model, meshes in self._models.values():
            file.add(model, meshes)
        for grip in self._grips:
            file.weld(grip)
        self._model, self._data = _compiled(file, "the world")
        bodies: dict[str, dict[str, int]] = {}
        for number, (model, link) in enumerate(file.links, 1):
            bodies.setdefault(model.name, {})[link] = number
        self._rows = {
            name: ModelRows(model, bodies[name], file, self._model)
            for name, (model, _) in self._models.items()
        }
        self._may_overlap = True
        self._trace = None
        self._geoms = file.geoms
        self._restitutions = np.array(file.restitutions)
        free = self._model.jnt_type == mujoco.mjtJoint.mjJNT_FREE
        dofs = self._model.jnt_dofadr[free][:, np.newaxis]
        self._spins = (dofs + np.array([3, 4, 5])).ravel()
        self._is_compiled = True
        self._write_properties()
        self._write_drives()
        self._find_weightless()
        for model, _ in self._models.values():
            self._write(model)
            for name in model.ode_joints:
                self.update_joint(model, name)
        moving = [rows for rows in self._rows.values() if rows.can_move]
        reader = Reader(self._model, self._data, moving)
        self._moving = MovingModels([rows.model for rows in moving], reader.read)

    def _write_drives(self) -> None:
        """Write the drives of all joints."""
        self._joints = MujocoDrives(self._model, self._data)
        for rows in self._rows.values():
            self._joints.add(self._drives[rows.model.name], rows)
        mujoco.mj_setConst(self._model, self._data)

    def set_properties(self, properties: PhysicsProperties) -> None:
        """Set the properties; MuJoCo uses some of them."""
        self._rest.wake()
        self.properties = properties
        if self._is_compiled:
            self._write_properties()

    def _write_properties(self) -> None:
        self._may_overlap = True
        properties, option = self.properties, self._model.opt
        step = properties.time_step or PhysicsProperties.time_step
        option.timestep = step
        option.gravity[:] = properties.gravity
        option.iterations = max(1, properties.sor_pgs_iters)
        self._spin_speed = MAX_SPIN / step
        self._choose_integrator()
        option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
        option.impratio = FRICTION_RATIO
        option.disableflags |= mujoco.mjtDisableBit.mjDSBL_AUTORESET
        # An error decays within the time in which erp corrects it.
        decay = step / min(max(properties.erp, 0.01), 0.5)
        self._model.geom_solref[:] = decay, 1.0
        # Where a damped contact pushes with the largest speed.
        self._slow_depth = 2.0 * MAX_DEPENETRATION_SPEED * decay * IMPEDANCE[0]
        ratios = damping_ratios(self._restitutions)
        self._model.pair_solref[:] = np.stack([decay / ratios, ratios], axis=1)
        self._model.pair_solimp[:] = IMPEDANCE
        self._model.geom_solimp[:] = IMPEDANCE
        self._model.jnt_solref[:] = decay, 1.0
        self._model.jnt_solimp[:] = IMPEDANCE
        self._model.eq_solref[:] = decay, 1.0
        self._model.eq_solimp[:] = IMPEDANCE

    # --- states ---

    def _changed(self, model: Model) -> ModelRows | None:
        """Wake the world; return a model's rows if they can be written to."""
        self._rest.wake()
        return self._rows.get(model.name) if self._is_compiled else None

    def write(self, model: Model) -> None:
        """Write roots and joints of a model; motor targets stay."""
        self._may_overlap = True
        if self._changed(model) is not None:
            self._write(model)

    def _write(self, model: Model) -> None:
        rows, data = self._rows[model.name], self._data
        for number, (tree, body) in enumerate(zip(model.trees, rows.roots)):
            pose, twist = model.root_poses[number], model.root_twists[number]
            wxyz = pose[[6, 3, 4, 5]]
            if tree.fixed:
                mocap = self._model.body_mocapid[body]
                data.mocap_pos[mocap], data.mocap_quat[mocap] = pose[:3], wxyz
                continue
            joint = self._model.body_jntadr[body]
            at = self._model.jnt_qposadr[joint]
            lever = rotate(pose[3:], rows.centers[number])
            data.qpos[at : at + 3] = pose[:3] + lever
            data.qpos[at + 3 : at + 7] = wxyz
            at = self._model.jnt_dofadr[joint]
            data.qvel[at : at + 3] = twist[:3] + cross(twist[3:], lever)
            data.qvel[at + 3 : at + 6] = rotate(conjugate(pose[3:]), twist[3:])
        data.qpos[rows.position] = model.position
        data.qvel[rows.velocity] = model.velocity

    def write_joints(self, model: Model, rows: Iterable[int]) -> None:
        """Write some joints of a model."""
        self._may_overlap = True
        found, own = self._changed(model), np.array([*rows], dtype=int)
        if found is not None:
            self._data.qpos[found.position[own]] = model.position[own]
            self._data.qvel[found.velocity[own]] = model.velocity[own]

    def _update_drives(self, model: Model, rows: np.ndarray) -> None:
        """Apply the drives of some joints."""
        found = self._changed(model)
        if found is not None:
            self._joints.update(self._drives[model.name], found)

    def _update_targets(self, model: Model, rows: np.ndarray) -> None:
        """Apply the targets of some joints."""
        found = self._changed(model)
        if found is not None:
            self._joints.set_targets(self._drives[model.name], found)

    def follow(
        self,
        model: Model,
        rows: np.ndarray,
        positions: np.ndarray,
        velocities: np.ndarray,
    ) -> None:
        """Set targets of a model's own motors, also for each of the next steps."""
        super().follow(model, rows, positions, velocities)
        if positions.ndim == 2 and len(positions) > 1 and model.name in self._drives:
            self._compile()
            path = np.stack([positions, velocities])
            self._joints.plan(self._rows[model.name].velocity[rows], path)

    # --- steps ---

    def _advance(self, count: int) -> None:
        """Compute time steps."""
        self._compile()
        model, data, joints = self._model, self._data, self._joints
        self._is_driven = bool(self._forces or self._joint_efforts or joints.has_path)
        self._apply_forces()
        joints.prepare(count, self.properties.time_step)
        qpos, qvel, of_springs = data.qpos, data.qvel, data.actuator_force
        positions, velocities = np.zeros((count, model.nq)), np.zeros((count, model.nv))
        friction, springs = [], np.zeros((count, model.nu))
        last, speed = qpos.copy(), math.sqrt(qvel.dot(qvel))
        for step in range(count):
            if speed > self._spin_speed or self._is_spinning:
                self._choose_integrator()
            mujoco.mj_step1(model, data)
            joints.apply(step)
            if self._may_overlap or speed > HIT_SPEED:
                self._slow_separation()
            mujoco.mj_step2(model, data)
            speed = math.sqrt(qvel.dot(qvel))
            if not speed <= MAX_SPEED:  # also where it is NaN
                self._restore(last)
                speed = 0.0
            positions[step], velocities[step], last = qpos, qvel, positions[step]
            friction.append(data.efc_force[data.ne : data.ne + data.nf].copy())
            springs[step] = of_springs
        data.xfrc_applied[:] = 0.0
        data.qfrc_applied[:] = 0.0
        by_dof = np.zeros((count, model.nv))
        by_dof[:, data.efc_id[data.ne : data.ne + data.nf]] = friction
        self._trace = Trace(model, positions, velocities, by_dof, springs)

    def _choose_integrator(self) -> None:
        """Take the slower integrator while a free body spins fast."""
        spins = np.abs(self._data.qvel[self._spins])
        self._is_spinning = bool((spins > self._spin_speed).any())
        integrators = mujoco.mjtIntegrator
        self._model.opt.integrator = (
            integrators.mjINT_IMPLICIT
            if self._is_spinning
            else integrators.mjINT_IMPLICITFAST
        )

    def _restore(self, positions: np.ndarray) -> None:
        """Put all models at rest where they were before a step that failed."""
        data = self._data
        self._may_overlap = True
        data.qpos[:] = positions
        for name in ("qvel", "qacc", "qacc_warmstart", "actuator_force", "efc_force"):
            getattr(data, name)[:] = 0.0
        self._failure = FAILURE

    def _apply_forces(self) -> None:
        """Write the forces of the next steps."""
        data = self._data
        for body, mass in self._weightless.items():
            data.xfrc_applied[body, :3] -= mass * np.array(self.properties.gravity)
        for model, link, wrench in self._forces:
            rows = self._rows.get(model.name)
            if rows is not None and link in rows.bodies:
                data.xfrc_applied[rows.bodies[link]] += wrench
        for model, row, effort in self._joint_efforts:
            rows = self._rows.get(model.name)
            if rows is not None:
                data.qfrc_applied[rows.velocity[row]] += effort
        self._forces.clear()
        self._joint_efforts.clear()

    def _slow_separation(self) -> None:
        """Bound the speed at which contacts push overlapping links apart.

        Only models that were placed or are fast overlap deeply.
        """
        data = self._data
        rows = slice(data.ne + data.nf + data.nl, None)
        self._may_overlap = bool((data.efc_pos[rows] < -self._slow_depth).any())
        if not self._may_overlap:
            return
        stiffness, damping, impedance, _ = data.efc_KBIP[rows].T
        depth = data.efc_margin[rows] - data.efc_pos[rows]
        excess = stiffness * impedance * depth - damping * MAX_DEPENETRATION_SPEED
        is_fast = (excess > 0.0) & (damping**2 > 3.9 * stiffness)  # others bounce
        if is_fast.any():
            data.efc_aref[rows] -= np.where(is_fast, excess, 0.0)

    # --- joints, forces and contacts ---

    def efforts(self, model: Model) -> np.ndarray:
        """Read the efforts of motors in the last step."""
        is_known = self._is_compiled and model.name in self._drives
        if not is_known or self._trace is None:
            return np.zeros(len(model.joint_names))
        name = model.name
        return self._trace.efforts(self._drives[name], self._rows[name])[-1]

    def _speeds(self) -> Sequence[float]:
        """Return the largest speed after each step that can end or begin a rest."""
        assert self._trace is not None, "there was a step"
        velocities = self._trace.qvel
        if self._is_driven or (np.abs(velocities[-1]) > REST_SPEED).any():
            velocities = velocities[-1:]  # each step before woke the world
        speeds: list[float] = np.abs(velocities).max(axis=1, initial=0.0).tolist()
        return speeds

    def last_steps(self, model: Model, count: int) -> Steps:
        """Return a model after and in the last steps."""
        if not (self._has_advanced and self._is_compiled) or self._trace is None:
            return super().last_steps(model, count)
        return self._trace.steps(self._drives[model.name], self._rows[model.name])

    def apply_wrench(self, model: Model, link: str, wrench: np.ndarray) -> None:
        """Apply a wrench to a link in the next steps."""
        self._rest.wake()
        self._forces.append((model, link, wrench))

    def apply_effort(self, model: Model, row: int, effort: float) -> None:
        """Apply an effort to a joint in the next steps."""
        self._rest.wake()
        self._joint_efforts.append((model, row, effort))

    def _set_stops(self, model: Model, row: int, low: float, high: float) -> None:
        """Set the stops of a joint."""
        rows = self._changed(model)
        if rows is not None:
            self._model.jnt_range[rows.joints[row]] = low, high
            self._model.jnt_limited[rows.joints[row]] = True

    def update_gravity(self, model: Model) -> None:
        """Apply which links of a model have gravity."""
        if self._changed(model) is not None:
            self._find_weightless()

    def _find_weightless(self) -> None:
        """Find the links without gravity, and their masses."""
        self._weightless = {
            rows.bodies[name]: link.inertial.mass
            for rows in self._rows.values()
            for name, link in rows.model.links.items()
            if link.inertial is not None
            and not link.has_gravity
            and name in rows.bodies
        }

    def contacts(self) -> set[tuple[str, str]]:
        """Find the pairs of links that touch or overlap now."""
        self._compile()
        # Other data, as a search for contacts empties the constraints of the last step.
        model, data = self._model, mujoco.MjData(self._model)
        for name in ("qpos", "mocap_pos", "mocap_quat"):
            getattr(data, name)[:] = getattr(self._data, name)
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_collision(model, data)
        # Degrees of freedom of the first body above that is not fixed to its parent.
        freedoms = model.body_dofnum[model.body_weldid]
        pairs = set()
        for number in range(data.ncon):
            contact = data.contact[number]
            if contact.dist > 0.0:
                continue
            ends = [self._geoms[geom] for geom in contact.geom]
            if any(freedoms[self._rows[m.name].bodies[link]] for m, link in ends):
                names = (f"{owner.name}{SCOPE}{link}" for owner, link in ends)
                first, second = sorted(names)
                pairs.add((first, second))
        return pairs


def damping_ratios(restitutions: np.ndarray) -> np.ndarray:
    """Compute the damping with which a spring throws a mass back.

    A mass leaves a spring that does not pull when the force is zero, after half an
    oscillation less 2 asin(d), with the damping ratio d. Its velocity is then that
    before times exp(-tan(asin(d)) (pi - 2 asin(d))).

    Args:
        restitutions: Velocities after and before, from 0 to 1, shape (n,).

    Returns:
        Relative to critical damping, shape (n,); 1 for less than exp(-2).
    """
    angles = np.linspace(1e-3, np.pi / 2.0 - 1e-6, 2000)
    found = np.exp(-np.tan(angles) * (np.pi - 2.0 * angles))
    return np.asarray(np.sin(np.interp(-restitutions, -found, angles)))


def _compiled(file: WorldFile, name: str) -> tuple[Any, Any]:
    """Compile a world.

    Returns:
        MuJoCo's model, with the inertias of the file, and its data.

    Raises:
        DescriptionError: If MuJoCo refuses it.
    """
    try:
        model = mujoco.MjModel.from_xml_string(file.text())
    except ValueError as error:
        raise DescriptionError(f"MuJoCo cannot load {name}: {cause(error)}.") from error
    model.body_inertia[1:] = np.array(file.inertias).reshape(-1, 3)
    # As numbered in the file: free joints have no actuator.
    model.jnt_range[model.actuator_trnid[:, 0]] = np.reshape(file.ranges, (-1, 2))
    data = mujoco.MjData(model)
    mujoco.mj_setConst(model, data)
    return model, data
