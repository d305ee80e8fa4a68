"""The border between the world and an engine, which computes its physics.

Each engine lies in a folder of its own, with the library that it needs. Only this
module knows which engines exist.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Iterable
from dataclasses import dataclass, fields
from importlib import import_module

import numpy as np

from g1_description.bounds import MAX_VALUE
from g1_description.errors import InvalidValueError, UnknownNameError
from g1_description.motion.motors import Motors
from g1_description.robot.launch_arguments import PHYSICS
from g1_description.sim.model import Model

MAX_TIME_STEP = 10.0
"""Longest time step in [s]: the limit of Gazebo's dynamic_reconfigure."""

GRAVITY = ("gravity_x", "gravity_y", "gravity_z")
"""Names of gravity's numbers."""

MAX_EFFORT = 1e6
"""Effort limit of a joint whose file gives none, or 0 as exporters do where they know
none, in [N m] or [N]: PyBullet takes no infinity."""

_WHOLE_NUMBERS = ("sor_pgs_precon_iters", "sor_pgs_iters", "max_contacts")


@dataclass(frozen=True)
class PhysicsProperties:
    """Numbers of the world and of Gazebo's engine, ODE, in Gazebo's words.

    Of ODE's numbers those take effect that PyBullet knows too: ``sor_pgs_iters``,
    ``erp`` and ``cfm``. The others are kept and read back.
    """

    time_step: float = 0.001
    """Length of a physics step, in [s]."""

    max_update_rate: float = 1000.0
    """Steps per second of wall time; 0: as fast as possible, in [Hz]."""

    gravity_x: float = 0.0
    """Gravity, in [m/s^2]."""

    gravity_y: float = 0.0
    gravity_z: float = -9.8

    auto_disable_bodies: bool = False
    """Stored and returned without effect."""

    sor_pgs_precon_iters: int = 0
    """Without effect."""

    sor_pgs_iters: int = 50
    """Iterations of PyBullet's solver."""

    sor_pgs_w: float = 1.3
    """Without effect."""

    sor_pgs_rms_error_tol: float = 0.0
    """Without effect."""

    cfm: float = 0.0
    """Softness of constraints."""

    erp: float = 0.2
    """Share of a constraint error corrected per step."""

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
                    f"{field.name} is {value}, it must be from {low:g} to {high:g}"
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
        """Wall time from one step to the next in [s]; 0: as short as can be."""
        return 1.0 / self.max_update_rate if self.max_update_rate > 0.0 else 0.0


_RANGES = {
    "time_step": (0.0, MAX_TIME_STEP),
    **dict.fromkeys(GRAVITY, (-MAX_VALUE, MAX_VALUE)),
    "sor_pgs_rms_error_tol": (-1.0, MAX_VALUE),
    **dict.fromkeys(_WHOLE_NUMBERS, (0, 2**32 - 1)),
    "sor_pgs_iters": (0, 1000),
    "cfm": (0.0, 10.0),
    "erp": (0.0, 10.0),
}
"""Least and largest values; those of ODE's numbers are as wide as PyBullet allows."""


class Engine(ABC):
    """Moves the models of a world and finds their contacts.

    It builds bodies from ``Model.assembly``, writes a model's state to them, and gives
    the models new states by ``Model.set_measured_state``. In ``kinematic`` physics
    nothing moves by itself, and bodies serve contacts only; in ``hold`` motors drive
    all joints; in ``limp`` friction and damping alone act on them. Models without
    links have no body.
    """

    def __init__(self, physics: str, properties: PhysicsProperties) -> None:
        if physics not in PHYSICS:
            raise UnknownNameError(
                f"There is no physics '{physics}'; there are {', '.join(PHYSICS)}."
            )
        self.physics = physics
        self.properties = properties

    @property
    def is_dynamic(self) -> bool:
        """Whether things move by themselves."""
        return self.physics != "kinematic"

    @abstractmethod
    def close(self) -> None:
        """Free the engine's memory."""

    @abstractmethod
    def set_properties(self, properties: PhysicsProperties) -> None:
        """Compute with other numbers from now on."""

    @abstractmethod
    def add(self, model: Model) -> tuple[str, ...]:
        """Build a model in its state, and note its thinned hulls in it.

        Returns:
            A message for each thing that was left out.

        Raises:
            DescriptionError: If that fails; nothing is changed.
        """

    @abstractmethod
    def remove(self, name: str) -> None:
        """Remove a model of that name."""

    @abstractmethod
    def replace(self, model: Model) -> None:
        """Build a model again, with the links that it has now.

        Raises:
            DescriptionError: If that fails; the old one stays.
        """

    @abstractmethod
    def rebuild(self, models: Iterable[Model]) -> None:
        """Build all models again, so that nothing of the past has an influence."""

    @abstractmethod
    def step(self) -> None:
        """Compute one time step; the models keep their states until an update."""

    @abstractmethod
    def update_models(self) -> None:
        """Give the models the states that the step has computed."""

    @abstractmethod
    def write(self, model: Model) -> None:
        """Take over roots and joints of a model; motors keep their targets."""

    @abstractmethod
    def write_joints(self, model: Model, rows: Iterable[int]) -> None:
        """Take over some movable joints of a model; motors hold them there."""

    @abstractmethod
    def follow(
        self,
        model: Model,
        rows: np.ndarray,
        positions: np.ndarray,
        velocities: np.ndarray,
    ) -> None:
        """Set targets of motors.

        Args:
            model: The model.
            rows: Rows of its movable joints, shape (n,).
            positions: In [rad] or [m], shape (n,).
            velocities: In [rad/s] or [m/s], shape (n,).
        """

    @abstractmethod
    def efforts(self, model: Model) -> np.ndarray:
        """Read the efforts of motors in the last step, in [N m] or [N].

        Zeros before the first one, shape (n_joints,).
        """

    @abstractmethod
    def effort_limits(self, model: Model) -> np.ndarray:
        """Return the largest efforts of motors, in [N m] or [N], shape (n_joints,).

        Infinite where neither the robot's file nor that of the motors has a limit.
        """

    @abstractmethod
    def apply_wrench(self, model: Model, link: str, wrench: np.ndarray) -> None:
        """Apply a wrench to a link in the next step.

        Args:
            model: The model.
            link: The link's name.
            wrench: Force at the center of mass in [N] and torque in [N m], along the
                world's axes, shape (6,).
        """

    @abstractmethod
    def apply_effort(self, model: Model, row: int, effort: float) -> None:
        """Apply an effort to a movable joint in the next step, in [N m] or [N]."""

    @abstractmethod
    def update_joint(self, model: Model, name: str) -> None:
        """Take over the ``ode_joints`` of a movable joint, as far as they are known."""

    @abstractmethod
    def update_gravity(self, model: Model) -> None:
        """Take over which links of a model gravity pulls."""

    @abstractmethod
    def contacts(self) -> set[tuple[str, str]]:
        """Find the pairs of links that touch or overlap now.

        Links of the same model do not collide, as in Gazebo; neither do things that are
        fixed to the world.

        Returns:
            Pairs of ``model::link``, each pair once, in alphabetical order.
        """


def make_engine(
    physics: str, properties: PhysicsProperties, motors: Motors | None = None
) -> Engine:
    """Make an engine without models.

    Args:
        physics: One of ``PHYSICS``.
        properties: The physics' numbers.
        motors: Motors of the joints in ``hold`` physics; None: motors as strong as the
            robots' files say.

    Raises:
        UnknownNameError: If there is no such physics.
    """
    # Imported by name and on use: an engine knows this module, not the reverse, and its
    # library loads slowly.
    module = import_module("g1_description.sim.bullet.engine")
    engine: Engine = module.BulletEngine(physics, properties, motors)
    return engine
