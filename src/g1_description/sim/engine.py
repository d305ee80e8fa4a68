"""The interface of physics engines; each engine is in its own folder."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, fields
from typing import NamedTuple

import numpy as np

from g1_description.bounds import MAX_VALUE
from g1_description.choices import PHYSICS
from g1_description.errors import (
    InvalidValueError,
    NoSuchMotorsError,
    UnknownNameError,
)
from g1_description.motion.motors import Motors, motors_of
from g1_description.robot.dynamics import GRAVITY
from g1_description.robot.profile import is_profile
from g1_description.sim.drives import MAX_EFFORT, Drives, PdCommand
from g1_description.sim.grip import Grip
from g1_description.sim.model import Model
from g1_description.sim.moving_models import MovingModels, RestDetector
from g1_description.text import listed

MAX_TIME_STEP = 10.0
"""Longest time step in [s]: the limit of Gazebo's dynamic_reconfigure."""

GRAVITY_AXES = ("gravity_x", "gravity_y", "gravity_z")
"""Names of the components of gravity."""

FAILURE = (
    "physics failed in a step, as forces or gains are too large: all models are at "
    "rest where they were before it"
)
"""Message of ``Engine.take_failure``."""

MAX_STEPS = 20
"""Largest number of steps that are computed together: requests wait for them."""

_WHOLE_NUMBERS = ("sor_pgs_precon_iters", "sor_pgs_iters", "max_contacts")


@dataclass(frozen=True)
class PhysicsProperties:
    """Physics properties, by Gazebo's names.

    Of ODE's properties ``sor_pgs_iters`` and ``erp`` take effect, and ``cfm`` in
    PyBullet; the others are stored and returned.
    """

    time_step: float = 0.001
    """Length of a physics step, in [s]."""

    max_update_rate: float = 1000.0
    """Maximum rate of steps in wall time; 0: as fast as possible, in [Hz]."""

    gravity_x: float = 0.0
    """Gravity along the world's axes, in [m/s^2]."""

    gravity_y: float = 0.0
    gravity_z: float = -GRAVITY

    auto_disable_bodies: bool = False
    """Stored and returned without effect."""

    sor_pgs_precon_iters: int = 0
    """Without effect."""

    sor_pgs_iters: int = 50
    """Most iterations of the solver."""

    sor_pgs_w: float = 1.3
    """Without effect."""

    sor_pgs_rms_error_tol: float = 0.0
    """Without effect."""

    cfm: float = 0.0
    """Constraint force mixing: softness of constraints; without effect in MuJoCo."""

    erp: float = 0.2
    """Error reduction parameter: fraction of a constraint error corrected per step."""

    contact_surface_layer: float = 0.001
    """Without effect, in [m]."""

    contact_max_correcting_vel: float = 100.0
    """Without effect, in [m/s]."""

    max_contacts: int = 20
    """Without effect."""

    def __post_init__(self) -> None:
        """Check ranges.

        Raises:
            InvalidValueError: If a number is out of its range.
        """
        for field in fields(PhysicsProperties):
            value = getattr(self, field.name)
            low, high = _RANGES.get(field.name, (0.0, MAX_VALUE))
            if not low <= value <= high:
                raise InvalidValueError(
                    f"{field.name} must be from {low:g} to {high:g} (got {value})"
                )

    @property
    def gravity(self) -> tuple[float, float, float]:
        """Gravity along the world's axes in [m/s^2]."""
        return self.gravity_x, self.gravity_y, self.gravity_z

    @property
    def step_ns(self) -> int:
        """Length of a step in whole [ns]."""
        return round(self.time_step * 1_000_000_000)

    @property
    def period(self) -> float:
        """Wall time from one step to the next in [s]; 0: as short as possible."""
        return 1.0 / self.max_update_rate if self.max_update_rate > 0.0 else 0.0


_RANGES = {
    "time_step": (0.0, MAX_TIME_STEP),
    **dict.fromkeys(GRAVITY_AXES, (-MAX_VALUE, MAX_VALUE)),
    "sor_pgs_rms_error_tol": (-1.0, MAX_VALUE),
    **dict.fromkeys(_WHOLE_NUMBERS, (0, 2**32 - 1)),
    "sor_pgs_iters": (0, 1000),
    "cfm": (0.0, 10.0),
    "erp": (0.0, 10.0),
}
"""Ranges; those of ODE's properties are as wide as PyBullet allows."""


class Steps(NamedTuple):
    """A model in several steps."""

    positions: np.ndarray
    """Of the movable joints after each step, in [rad] or [m], shape (n, n_joints)."""

    velocities: np.ndarray
    """In [rad/s] or [m/s], of the same shape."""

    efforts: np.ndarray
    """Of the motors in each step, in [N m] or [N], shape (n, n_joints)."""

    base_poses: np.ndarray
    """T_world_base of the first root after each step, shape (n, 7)."""


class Engine(ABC):
    """Moves the models of a world and finds their contacts.

    It builds bodies from ``Model.assembly``, writes a model's state to them, and sets
    new states by ``Model.set_measured_state``. In ``kinematic`` physics bodies are used
    for contacts only; in ``hold`` motors drive all joints; in ``limp`` joints have only
    friction and damping. Models without links have no body. A world at rest sleeps:
    steps are skipped until the next write.
    """

    max_steps = 1
    """Largest number of steps that it computes together."""

    _moving: MovingModels

    def __init__(
        self,
        physics: str,
        properties: PhysicsProperties,
        motors: Motors | str | None = None,
    ) -> None:
        if physics not in PHYSICS:
            raise UnknownNameError(
                f"Unknown physics '{physics}'; must be one of {', '.join(PHYSICS)}."
            )
        self.physics = physics
        self.properties = properties
        self._given_motors = motors
        self._drives: dict[str, Drives] = {}
        self._grips: tuple[Grip, ...] = ()
        self._rest = RestDetector()
        self._has_advanced = False
        self._failure = ""

    @property
    def is_dynamic(self) -> bool:
        """Whether the engine moves models."""
        return self.physics != "kinematic"

    def add(self, model: Model) -> tuple[str, ...]:
        """Build a model at its state, and set its ``hull_deviations``.

        Returns:
            A message for each ignored part.

        Raises:
            DescriptionError: If that fails; nothing is changed.
        """
        if not model.link_names:
            return ()
        notes = self._add_drives(model)
        try:
            return self._add(model) + notes
        except BaseException:
            del self._drives[model.name]
            raise

    @abstractmethod
    def _add(self, model: Model) -> tuple[str, ...]:
        """Build a model that has drives, as ``add``."""

    def _add_drives(self, model: Model) -> tuple[str, ...]:
        """Give a model its motors, in ``hold``.

        Returns:
            A message if it lacks those of the engine's name, and on those without a
            limit, as that of the robot's file is 0.
        """
        if self.physics != "hold":
            self._drives[model.name] = Drives(model, None)
            return ()
        motors, notes = self._motors_of(model)
        profile = model.assembly.description.profile
        folder = profile.motors and profile.motors.parent
        # A profile may be like another one, whose robot has more joints.
        is_own = folder and (folder.name == profile.name or not is_profile(str(folder)))
        if is_own or isinstance(self._given_motors, Motors):
            notes += _unused(motors, model)
        self._drives[model.name] = Drives(model, motors)
        joints = model.assembly.description.movable_joints
        limits = self.effort_limits(model).tolist()
        unknown = [
            joint.name
            for joint, limit in zip(joints, limits)
            if joint.effort == 0.0 and limit == np.inf
        ]
        if unknown:
            notes += (
                f"the effort limit of {listed(unknown)} is 0, which means unknown: the "
                "motors have no limit in physics",
            )
        return notes

    def _motors_of(self, model: Model) -> tuple[Motors, tuple[str, ...]]:
        """Choose the motors of a model; return also a message if there are none."""
        given, description = self._given_motors, model.assembly.description
        if isinstance(given, Motors):
            return given, ()
        try:
            return motors_of(description, given or ""), ()
        except NoSuchMotorsError as error:
            is_reported = bool(description.movable_joints)
            return Motors(), (str(error).rstrip("."),) * is_reported

    @abstractmethod
    def close(self) -> None:
        """Release the engine's resources."""

    @abstractmethod
    def set_properties(self, properties: PhysicsProperties) -> None:
        """Set the properties from the next step on."""

    @abstractmethod
    def remove(self, name: str) -> None:
        """Remove a model of that name."""

    @abstractmethod
    def replace(self, model: Model) -> None:
        """Build a model again, with its current links.

        Raises:
            DescriptionError: If that fails; the old one stays.
        """

    def rebuild(self, models: Iterable[Model]) -> None:
        """Build all models again, with their motors, independent of past states."""
        known = [model for model in models if model.name in self._drives]
        for model in known:
            drives = self._drives[model.name]
            self._drives[model.name] = Drives(model, drives.motors)
        self._rest.wake()
        self._rebuild(known)

    @abstractmethod
    def _rebuild(self, models: Sequence[Model]) -> None:
        """Build models that have drives, and no others."""

    @property
    def is_resting(self) -> bool:
        """Whether the world sleeps."""
        return self._rest.is_resting

    def steady_steps(self) -> int:
        """Return how many steps can be computed together now.

        The world falls asleep after the last one, if at all.
        """
        return min(self.max_steps, self._rest.steps_left(self.properties.time_step))

    def advance(self, count: int) -> None:
        """Compute steps, unless the world sleeps; ``update_models`` applies them.

        Results do not depend on how steps are grouped.

        Args:
            count: Number of steps, at most ``steady_steps``.
        """
        self._has_advanced = not self._rest.is_resting
        if self._has_advanced:
            self._advance(count)
            self._moving.read()

    @abstractmethod
    def _advance(self, count: int) -> None:
        """Compute steps, and keep ``_moving`` up to date."""

    def last_steps(self, model: Model, count: int) -> Steps:
        """Return a model after and in the last steps, by default of one."""
        position, efforts = model.position[np.newaxis], self.efforts(model)[np.newaxis]
        velocity = model.velocity[np.newaxis]
        one = Steps(position, velocity, efforts, model.root_poses[:1])
        return one if count == 1 else Steps(*(np.repeat(a, count, axis=0) for a in one))

    def take_failure(self) -> str:
        """Return a message on steps that failed since the last call; else empty."""
        failure, self._failure = self._failure, ""
        return failure

    def update_models(self) -> None:
        """Set the models' states to the results of the last steps."""
        if self._rest.is_resting:
            return
        self._moving.update_models()
        for speed in self._speeds():
            self._rest.update(speed, self.properties.time_step)
        if self._rest.is_resting:
            self._moving.stop()

    def _speeds(self) -> Sequence[float]:
        """Return the largest speed after each of the last steps that matter to rest."""
        return [self._moving.speed]

    @abstractmethod
    def write(self, model: Model) -> None:
        """Write roots and joints of a model to the engine; motor targets stay."""

    @abstractmethod
    def write_joints(self, model: Model, rows: Iterable[int]) -> None:
        """Write some movable joints of a model; motor targets stay."""

    def hold(self, model: Model, rows: Sequence[int]) -> None:
        """Let a model's own motors hold movable joints at the model's targets."""
        own = np.array(rows, dtype=int)
        if self.is_dynamic and own.size:
            self.follow(model, own, model.target[own], np.zeros(len(own)))

    def follow(
        self,
        model: Model,
        rows: np.ndarray,
        positions: np.ndarray,
        velocities: np.ndarray,
    ) -> None:
        """Set targets of a model's own motors, which take the joints back.

        Args:
            model: The model.
            rows: Rows of its movable joints, shape (n,).
            positions: Target positions in [rad] or [m], shape (n,), or (n_steps, n)
                for each of the next steps; the last ones stay.
            velocities: Target velocities in [rad/s] or [m/s], of the same shape.
        """
        drives = self._drives.get(model.name)
        if drives is None:
            return
        is_driven, last = drives.is_driven, -1 if positions.ndim == 2 else slice(None)
        drives.follow(rows, positions[last], velocities[last])
        update = self._update_drives if is_driven else self._update_targets
        update(model, rows)

    def drive(self, model: Model, rows: np.ndarray, command: PdCommand) -> None:
        """Let a controller drive movable joints, until they get targets again.

        Args:
            model: The model.
            rows: Rows of its movable joints, shape (n,).
            command: The command to them.
        """
        if model.name in self._drives:
            self._drives[model.name].obey(rows, command)
            self._update_drives(model, rows)

    @abstractmethod
    def _update_drives(self, model: Model, rows: np.ndarray) -> None:
        """Apply the drives of some movable joints from the next step on."""

    def _update_targets(self, model: Model, rows: np.ndarray) -> None:
        """Apply the targets of joints that their own motors drive, as before."""
        self._update_drives(model, rows)

    @abstractmethod
    def efforts(self, model: Model) -> np.ndarray:
        """Read the efforts of motors in the last step, in [N m] or [N].

        Zeros before the first one, shape (n_joints,).
        """

    def effort_limits(self, model: Model) -> np.ndarray:
        """Return the largest efforts of motors, in [N m] or [N], shape (n_joints,).

        Infinite where neither the robot's file nor that of the motors has a limit.
        """
        drives = self._drives.get(model.name)
        limits = np.zeros(0) if drives is None else drives.limits
        return np.where(limits < MAX_EFFORT, limits, np.inf)

    @abstractmethod
    def apply_wrench(self, model: Model, link: str, wrench: np.ndarray) -> None:
        """Apply a wrench to a link in the steps of the next ``advance``.

        Args:
            model: The model.
            link: The link's name.
            wrench: Force at the center of mass in [N] and torque in [N m], along the
                world's axes, shape (6,).
        """

    @abstractmethod
    def apply_effort(self, model: Model, row: int, effort: float) -> None:
        """Apply an effort, in [N m] or [N], to a joint in those steps, too."""

    def update_joint(self, model: Model, name: str) -> None:
        """Apply damping and stops of a joint in ``ode_joints``, if it is movable."""
        row, given = model.joint_row(name), model.ode_joints[name]
        if row is None:
            return
        if "damping" in given:
            self._drives[model.name].joint_damping[row] = given["damping"]
            self._update_drives(model, np.array([row]))
        if "loStop" in given or "hiStop" in given:
            low = max(given.get("loStop", float(model.lower[row])), -MAX_VALUE)
            high = min(given.get("hiStop", float(model.upper[row])), MAX_VALUE)
            self._set_stops(model, row, low, high)

    @abstractmethod
    def _set_stops(self, model: Model, row: int, low: float, high: float) -> None:
        """Set both stops of a movable joint, in [rad] or [m]."""

    @abstractmethod
    def update_gravity(self, model: Model) -> None:
        """Apply which links of a model have gravity."""

    def fix(self, grips: Sequence[Grip]) -> None:
        """Fix objects to the links that carry them, and no others.

        Each passes through its link. In ``kinematic`` physics nothing changes.
        """
        self._rest.wake()
        self._grips = tuple(grips) if self.is_dynamic else ()

    @abstractmethod
    def contacts(self) -> set[tuple[str, str]]:
        """Find the pairs of links that touch or overlap now.

        As in Gazebo, links of one model do not collide, nor do fixed objects.

        Returns:
            Sorted pairs of ``model::link``.
        """


def _unused(motors: Motors, model: Model) -> tuple[str, ...]:
    """Describe patterns of motors that match no joint of a model that has joints."""
    names = [joint.name for joint in model.assembly.description.movable_joints]
    patterns = motors.unused(names) if names else []
    return (
        (f"the file of motors has patterns of no joint: {listed(patterns)}",)
        if patterns
        else ()
    )
