"""The simulated world: models, time, and what may be done to them.

One thread calls it; nothing here knows ROS. Calls between two steps take
effect at once, and the same calls at the same steps give the same bits.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
import pybullet
from pybullet_utils.bullet_client import BulletClient

from ..core.description import Description, Link, parse_urdf
from ..core.errors import DescriptionError, UnknownNameError
from ..core.lumping import Lumped, lump_fixed_joints
from ..core.rotation import conjugate, rotate
from ..core.transform import IDENTITY, compose, inverse
from .body import Body
from .contacts import contacts
from .frames import find_frame
from .model import SCOPE, Model, Report
from .urdf_import import check_mass, check_size, load, unread_shapes
from .urdf_text import prepared_urdf

PHYSICS = ("kinematic", "hold", "limp")
GROUND = "ground_plane"
_SECOND = 1_000_000_000
_SOLVER_ITERATIONS = 50


class World:
    """Gravity, a ground plane, and models that come and go.

    Physics ``kinematic``: what is set stays set, to the last bit; time runs,
    nothing falls, contacts are still found. ``hold``: full dynamics, motors hold
    the joints where they were last set. ``limp``: full dynamics, no motors.
    """

    def __init__(
        self,
        physics: str = "kinematic",
        time_step: float = 0.001,
        gravity: tuple[float, float, float] = (0.0, 0.0, -9.8),
        package_folder: Callable[[str], str | None] = lambda name: None,
    ) -> None:
        """Make a world with only the ground in it.

        Args:
            physics: One of ``PHYSICS``.
            time_step: Length of a step in [s], a whole number of nanoseconds.
            gravity: Acceleration in [m/s^2].
            package_folder: Gives a package's folder, None if there is none.
        """
        if physics not in PHYSICS:
            raise UnknownNameError(
                f"There is no physics '{physics}'; there are {', '.join(PHYSICS)}."
            )
        self.physics = physics
        self.time_step = time_step
        self.gravity = gravity
        self._package_folder = package_folder
        self._client = BulletClient(pybullet.DIRECT)
        self.time_ns = 0
        """Simulated time in [ns]."""
        self.models: dict[str, Model] = {}
        self._bodies: dict[str, Body] = {}
        self._loads: dict[str, Callable[[Model], int]] = {}
        self._set_up_physics()
        ground = Description(GROUND, "link", (Link("link"),), ())
        lumped = Lumped(ground, {"link": ("link", IDENTITY)}, True, IDENTITY, ())
        self._add(Model(GROUND, lumped, IDENTITY), self._load_ground)

    def close(self) -> None:
        """Let PyBullet go."""
        self._client.disconnect()

    def _set_up_physics(self) -> None:
        """Set what holds for the whole world."""
        self._client.setTimeStep(self.time_step)
        self._client.setGravity(*self.gravity)
        self._client.setPhysicsEngineParameter(
            numSolverIterations=_SOLVER_ITERATIONS, deterministicOverlappingPairs=1
        )

    def _load_ground(self, model: Model) -> int:
        """Load an endless plane."""
        shape = self._client.createCollisionShape(self._client.GEOM_PLANE)
        return self._client.createMultiBody(0.0, shape, basePosition=model.pose[:3])

    def spawn(
        self, name: str, urdf: str, pose: np.ndarray, fixed_base: bool = False
    ) -> tuple[str, ...]:
        """Add a robot.

        Args:
            name: Name in the world; must be free.
            urdf: Its description as URDF text.
            pose: Pose of the model frame in the world, shape (7,).
            fixed_base: Whether its root link does not move.

        Returns:
            A clause for each thing in the file that was left out.

        Raises:
            DescriptionError: If the robot cannot be read or loaded; the world
                stays as it was.
        """
        if name in self.models:
            raise DescriptionError(f"A model called '{name}' is already there.")
        lumped = lump_fixed_joints(parse_urdf(urdf))
        if self.physics != "kinematic":
            check_size(lumped.description)
        text, left_out = prepared_urdf(lumped.description, self._package_folder)
        fixed = lumped.fixed_to_world or (fixed_base and self.physics != "kinematic")

        def load_robot(model: Model) -> int:
            robot = lumped.description
            number = load(self._client, robot, text, model.root_pose, fixed)
            check_mass(self._client, number, robot, fixed)
            return number

        self._add(
            Model(name, lumped, pose), load_robot if lumped.description.links else None
        )
        if name in self._bodies:
            number = self._bodies[name].number
            left_out += unread_shapes(self._client, number, lumped.description, text)
        return left_out + tuple(f"link {link} has no mass" for link in lumped.vanished)

    def _add(self, model: Model, loader: Callable[[Model], int] | None) -> None:
        """Take a model into the world and give it a body, or leave all as it was."""
        bodies = self._client.getNumBodies()
        try:
            if loader is not None:
                self._loads[model.name] = loader
                self._embody(model)
        except BaseException:
            del self._loads[model.name]
            for index in range(bodies, self._client.getNumBodies()):
                self._client.removeBody(self._client.getBodyUniqueId(index))
            raise
        self.models[model.name] = model

    def _embody(self, model: Model) -> None:
        """Load a model's body and prepare it for this world's physics."""
        number = self._loads[model.name](model)
        body = Body(self._client, number, model)
        if self.physics == "hold":
            body.hold()
        self._bodies[model.name] = body

    def delete(self, name: str) -> None:
        """Remove a model.

        Raises:
            UnknownNameError: If there is no such model.
        """
        self.model(name)
        if name in self._bodies:
            self._client.removeBody(self._bodies.pop(name).number)
            del self._loads[name]
        del self.models[name]

    def step(self) -> None:
        """Let one time step pass."""
        self.time_ns += round(self.time_step * _SECOND)
        if self.physics == "kinematic":
            return
        self._client.stepSimulation()
        for name, body in self._bodies.items():
            if name != GROUND:
                body.read()

    def model(self, name: str) -> Model:
        """Find a model.

        Raises:
            UnknownNameError: If there is none of this name.
        """
        if name not in self.models:
            raise UnknownNameError(
                f"There is no model '{name}'; there are {', '.join(self.models)}."
            )
        return self.models[name]

    def link_names(self) -> list[str]:
        """List all links as ``model::link``, in the order of ``link_states``."""
        return [
            f"{model.name}{SCOPE}{link}"
            for model in self.models.values()
            for link in model.link_names
        ]

    def link_states(self) -> tuple[np.ndarray, np.ndarray]:
        """Give the state of all links.

        Returns:
            Poses of the link frames in the world, shape (n_links, 7), and twists
            of their origins along the world's axes, shape (n_links, 6).
        """
        models = self.models.values()
        poses = [np.zeros((0, 7)), *(model.poses for model in models)]
        twists = [np.zeros((0, 6)), *(model.twists for model in models)]
        return np.concatenate(poses), np.concatenate(twists)

    def model_state(self, name: str, frame: str) -> tuple[np.ndarray, np.ndarray]:
        """Tell where a model is and how it moves, seen from a frame.

        Args:
            name: The model.
            frame: The reference frame, as for ``find_frame``.

        Returns:
            Pose in the frame, shape (7,), and the difference of the two twists
            along the frame's axes, shape (6,).

        Raises:
            UnknownNameError: If there is no such model or frame.
        """
        model = self.model(name)
        T_world_frame, frame_twist = find_frame(self.models, frame)
        difference = (model.twist - frame_twist).reshape(2, 3)
        twist = rotate(conjugate(T_world_frame[3:]), difference).reshape(6)
        return compose(inverse(T_world_frame), model.pose), twist

    def set_joint_positions(self, name: str, positions: Mapping[str, float]) -> Report:
        """Teleport joints of a model; it holds them there in ``hold``.

        Args:
            name: The model.
            positions: Positions in [rad] or [m] by joint name.

        Returns:
            What was not obeyed to the letter.

        Raises:
            UnknownNameError: If there is no such model.
            InvalidValueError: If a position is not finite; nothing is changed.
        """
        report = self.model(name).set_positions(positions)
        if name in self._bodies:
            body = self._bodies[name]
            body.write_joints()
            if self.physics == "hold":
                body.hold()
        return report

    def set_model_state(
        self, name: str, pose: np.ndarray, twist: np.ndarray, frame: str
    ) -> None:
        """Put a model somewhere, joints as they are.

        Args:
            name: The model.
            pose: Pose in the frame, shape (7,).
            twist: Velocity for the centers of mass and angular velocity, along
                the frame's axes, shape (6,). In ``kinematic`` nothing moves by
                itself, so it is ignored.
            frame: The reference frame, as for ``find_frame``.

        Raises:
            UnknownNameError: If there is no such model or frame.
        """
        model = self.model(name)
        T_world_frame, _ = find_frame(self.models, frame)
        turned = rotate(T_world_frame[3:], twist.reshape(2, 3)).reshape(6)
        still = self.physics == "kinematic" or name == GROUND
        model.set_state(compose(T_world_frame, pose), turned * (not still))
        if name in self._bodies:
            self._bodies[name].write()

    def reset_models(self) -> None:
        """Put all models where they were spawned, at rest, joints as they are."""
        for name, model in self.models.items():
            self.set_model_state(name, model.initial_pose, np.zeros(6), "")

    def reset(self) -> None:
        """Begin again: time zero, models as spawned, joints at zero.

        PyBullet's world is built anew, so that a second run equals the first to
        the last bit.
        """
        self.time_ns = 0
        self._client.resetSimulation()
        self._set_up_physics()
        self._bodies.clear()
        for name, model in self.models.items():
            model.rewind()
            if name in self._loads:
                self._embody(model)

    def contacts(self) -> set[tuple[str, str]]:
        """Find which links touch or overlap now.

        Returns:
            Pairs of ``model::link``, each pair once, in alphabetical order.
        """
        return contacts(self._client, self._bodies)
