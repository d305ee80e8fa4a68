"""The simulated world: models, lights, time, and what may be done to them.

One thread calls it; nothing here knows ROS. Calls between two steps take
effect at once, and the same calls at the same steps give the same bits.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from g1_description.core.errors import DescriptionError
from g1_description.core.robot.assembly import SCOPE, Assembly
from g1_description.core.robot.description import Inertial
from g1_description.core.rotation import cross, rotate
from g1_description.core.sdf.world import EMPTY_WORLD, Light, Sdf, read_sdf
from g1_description.core.transform import compose
from g1_description.sim.bullet.engine import Engine
from g1_description.sim.bullet.load import check_size

from .entities import Entities, Entity, named
from .forces import Jobs
from .link_placing import Placed, joint_above, place_link
from .model import Model, Report
from .physics import PhysicsProperties


class World:
    """Gravity, models and lights that come and go.

    Physics ``kinematic``: what is set stays set, to the last bit; time runs,
    nothing falls, contacts are still found. ``hold``: full dynamics, motors hold
    the joints where they were last set. ``limp``: full dynamics, no motors.
    """

    def __init__(
        self,
        physics: str = "kinematic",
        properties: PhysicsProperties | None = None,
        content: Sdf | None = None,
    ) -> None:
        """Make a world.

        Args:
            physics: One of ``engine.PHYSICS``.
            properties: The physics' numbers; Gazebo's where none are given.
            content: Models and lights; by default a ground plane and a sun. A model
                that cannot be loaded is left out.

        Raises:
            UnknownNameError: If there is no such physics.
        """
        self.properties = properties or PhysicsProperties()
        self._engine = Engine(physics, self.properties)
        self.models: dict[str, Model] = {}
        self.lights: dict[str, Light] = {}
        self.jobs = Jobs(self.is_dynamic)
        self._entities: Entities | None = None
        content = content or read_sdf(EMPTY_WORLD)
        self.time_ns = round(content.time * 1e9)
        """Simulated time in [ns]."""
        for light in content.lights:
            self.add_light(light)
        left_out = list(content.left_out)
        for model in content.models:
            try:
                clauses = self.spawn(model.name, model.assembly, model.pose)
            except DescriptionError as error:
                left_out.append(f"model {model.name} is left out: {error}".rstrip("."))
            else:
                left_out += [f"{model.name}: {clause}" for clause in clauses]
        self.left_out = tuple(left_out)
        """A clause for each thing of the content that was left out."""

    def close(self) -> None:
        """Let PyBullet go."""
        self._engine.close()

    @property
    def is_dynamic(self) -> bool:
        """Whether things move by themselves."""
        return self._engine.is_dynamic

    @property
    def entities(self) -> Entities:
        """All things by name."""
        if self._entities is None:
            self._entities = Entities(self.models.values(), self.lights.values())
        return self._entities

    def set_properties(self, properties: PhysicsProperties) -> None:
        """Compute with other numbers from now on."""
        self.properties = properties
        self._engine.set_properties(properties)

    def spawn(
        self, name: str, assembly: Assembly, pose: np.ndarray, fixed_base: bool = False
    ) -> tuple[str, ...]:
        """Add a model.

        Args:
            name: Name in the world; must be free.
            assembly: What it is made of.
            pose: Pose of the model frame in the world, shape (7,).
            fixed_base: Whether its root link does not move in ``hold`` and
                ``limp``.

        Returns:
            A clause for each thing in the file that was left out, and for joints that
            do not begin at zero.

        Raises:
            DescriptionError: If the model cannot be loaded; the world stays as it
                was.
        """
        if name in self.models:
            raise DescriptionError(f"A model called '{name}' is already there.")
        check_size(assembly.description, self.is_dynamic)
        if not self.is_dynamic:
            assembly = assembly.inside_limits()
        model = Model(name, assembly, pose, fixed_base and self.is_dynamic)
        left_out = self._engine.add(model)
        self.models[name] = model
        self._entities = None
        is_gone = assembly.left_out and not model.link_names
        nothing = ("nothing is left of the model",) if is_gone else ()
        return assembly.left_out + left_out + nothing

    def delete(self, name: str) -> None:
        """Remove a model.

        Raises:
            UnknownNameError: If there is no such model.
        """
        model = self.model(name)
        self.jobs.forget(model)
        self._engine.remove(name)
        del self.models[name]
        self._entities = None

    def add_light(self, light: Light) -> None:
        """Add a light, or replace the one of its name."""
        self.lights[light.name] = light
        self._entities = None

    def delete_light(self, name: str) -> None:
        """Remove a light.

        Raises:
            UnknownNameError: If there is no such light.
        """
        del self.lights[self.light(name).name]
        self._entities = None

    def step(self) -> None:
        """Let one time step pass."""
        self.time_ns += self.properties.step_ns
        if self.is_dynamic:
            self.jobs.act(self._engine, self.time_ns)
            self._engine.step()

    def model(self, name: str) -> Model:
        """Find a model.

        Raises:
            UnknownNameError: If there is none of this name.
        """
        return named("model", self.models, name)

    def light(self, name: str) -> Light:
        """Find a light.

        Raises:
            UnknownNameError: If there is none of this name.
        """
        return named("light", self.lights, name)

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

    def model_states(self) -> tuple[np.ndarray, np.ndarray]:
        """Give the state of all models.

        Returns:
            Poses of the model frames in the world, shape (n_models, 7), and twists of
            their canonical links' origins along the world's axes, shape (n_models, 6).
        """
        models = self.models.values()
        carriers = np.array([model.carrier_pose for model in models])
        offsets = np.array([model.T_carrier_model for model in models])
        twists = np.array([model.twist for model in models])
        poses = compose(carriers.reshape(-1, 7), offsets.reshape(-1, 7))
        return poses, twists.reshape(-1, 6)

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
        model = self.model(name)
        report = model.set_positions(positions)
        self._engine.write_joints(model)
        return report

    def set_model_state(
        self, model: Model, pose: np.ndarray, twist: np.ndarray, frame: Entity
    ) -> None:
        """Put a model somewhere, joints as they are.

        Args:
            model: The model.
            pose: Pose in the frame, shape (7,).
            twist: Velocity for the centers of mass and angular velocity, along
                the frame's axes, shape (6,). In ``kinematic`` nothing moves by
                itself, so it is ignored.
            frame: The reference frame.
        """
        T_world_frame = frame.pose
        turned = rotate(T_world_frame[3:], twist.reshape(2, 3)).reshape(6)
        model.set_state(compose(T_world_frame, pose), turned * self.is_dynamic)
        self._engine.write(model)

    def set_root_state(
        self, model: Model, pose: np.ndarray, twist: np.ndarray, tree: int = 0
    ) -> None:
        """Put a tree of a model somewhere by its root link; it moves as one.

        Args:
            model: The model.
            pose: Pose of the root link in the world, shape (7,).
            twist: Velocity of the root link's center of mass and its angular
                velocity, along the world's axes, shape (6,). Ignored in
                ``kinematic``.
            tree: Which of the model's trees.
        """
        model.set_root_state(pose, twist * self.is_dynamic, tree)
        self._engine.write(model)

    def set_link_state(
        self, entity: Entity, pose: np.ndarray, twist: np.ndarray
    ) -> Placed | None:
        """Put a link somewhere: a root with its model, others along their joint.

        Args:
            entity: The link.
            pose: Pose in the world, shape (7,).
            twist: Velocity of its center of mass and its angular velocity, along the
                world's axes, shape (6,). Ignored in ``kinematic``.

        Returns:
            How near its joint brought a link that is not the root.

        Raises:
            InvalidValueError: If it is fixed to another link; nothing is changed.
        """
        model = entity.model
        assert model is not None
        joint = joint_above(model, entity.name)
        if joint is None:
            self.set_root_state(model, pose, twist, model.tree_below(entity.row) or 0)
            return None
        inertial = entity.link.inertial
        twist = np.array(twist, dtype=float) * float(self.is_dynamic)
        if inertial is not None:
            lever = rotate(pose[3:], inertial.center_of_mass)
            twist[:3] -= cross(twist[3:], lever)
        placed = place_link(model, joint, pose, twist)
        self._engine.write_joints(model)
        return placed

    def set_link_properties(
        self, entity: Entity, inertial: Inertial, has_gravity: bool
    ) -> None:
        """Give a link another mass; the model's state stays as it is.

        Args:
            entity: The link.
            inertial: Its new mass, center of mass and inertia.
            has_gravity: Whether gravity pulls it.

        Raises:
            DescriptionError: If PyBullet refuses it; nothing is changed.
        """
        model = entity.model
        assert model is not None
        before, old = model.assembly, entity.link
        link = replace(old, inertial=inertial, gravity=has_gravity)
        model.assembly = before.with_link(link)
        if inertial == old.inertial:
            self._engine.weigh(model)
            return
        try:
            self._engine.replace(model)
        except DescriptionError:
            model.assembly = before
            raise

    def set_joint_properties(
        self, entity: Entity, numbers: Mapping[str, float]
    ) -> None:
        """Give a joint numbers of ODE, in Gazebo's words.

        ``damping``, ``loStop`` and ``hiStop`` take effect, the others are kept.
        """
        model = entity.model
        assert model is not None
        model.ode_joints.setdefault(entity.name, {}).update(numbers)
        self._engine.tune(model, entity.name)

    def reset_models(self) -> None:
        """Put all models where they were spawned, at rest, joints as they are."""
        for model in self.models.values():
            model.return_home()
            self._engine.write(model)

    def reset(self) -> None:
        """Begin again: time zero, models and joints as spawned, nothing acts.

        PyBullet's world is built anew, so that a second run equals the first to
        the last bit.
        """
        self.time_ns = 0
        self.jobs = Jobs(self.is_dynamic)
        for model in self.models.values():
            model.rewind()
        self._engine.rebuild(self.models.values())

    def contacts(self) -> set[tuple[str, str]]:
        """Find which links touch or overlap now, as ``contacts.contacts``."""
        return self._engine.contacts()
