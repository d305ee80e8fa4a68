"""The simulated world: models, lights, time, and what may be done to them.

One thread changes it; nothing here knows ROS. Calls between two steps take
effect at once, and the same calls at the same steps give the same bits.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from g1_description.errors import DescriptionError
from g1_description.motion.motors import Motors
from g1_description.robot.assembly import Assembly
from g1_description.robot.description import Inertial
from g1_description.robot.lumping import impossible_inertias
from g1_description.sdf.world import EMPTY_WORLD, Sdf, read_sdf
from g1_description.sim.bullet.create_body import check_size
from g1_description.sim.bullet.engine import Engine
from g1_description.sim.contents import Contents
from g1_description.sim.entities import Frame, JointEntity, LinkEntity, in_world
from g1_description.sim.forces import ForceSchedule
from g1_description.sim.link_placing import Placed, joint_above, place_link
from g1_description.sim.model import Model, Report
from g1_description.sim.motions import Motions
from g1_description.sim.physics import PhysicsProperties


class World(Contents):
    """Models and lights under gravity, while time passes.

    Physics ``kinematic``: what is set stays set, to the last bit; time runs, nothing
    falls, contacts are still found. ``hold``: full dynamics, motors hold the joints
    where they were last set. ``limp``: full dynamics, no motors.
    """

    def __init__(
        self,
        physics: str = "kinematic",
        properties: PhysicsProperties | None = None,
        content: Sdf | None = None,
        motors: Motors | None = None,
    ) -> None:
        """Make a world.

        Args:
            physics: One of ``engine.PHYSICS``.
            properties: The physics' numbers; Gazebo's where none are given.
            content: Models and lights; by default a ground plane and a sun. A model
                that cannot be loaded is left out.
            motors: What drives joints in ``hold``; the robots' files bound it anyway.

        Raises:
            UnknownNameError: If there is no such physics.
        """
        super().__init__()
        self._engine = Engine(physics, properties or PhysicsProperties(), motors)
        self.forces = ForceSchedule(self.is_dynamic)
        """Wrenches and efforts that act or will act."""
        self.motions = Motions(self._engine)
        """Motions that models go through or will go through."""
        content = content or read_sdf(EMPTY_WORLD)
        self.time_ns = round(content.time * 1e9)
        """Simulated time in [ns]."""
        self.left_out = (*content.left_out, *self._add_content(content))
        """A message for each thing of the content that was left out."""

    def _add_content(self, content: Sdf) -> list[str]:
        """Add the models and lights of a file; return messages on what is left out."""
        left_out = []
        for light in content.lights:
            self.add_light(light)
        for model in content.models:
            try:
                for message in self.spawn(model.name, model.assembly, model.pose):
                    left_out.append(f"{model.name}: {message}")
            except DescriptionError as error:
                left_out.append(f"model {model.name} is left out: {error}".rstrip("."))
        return left_out

    def close(self) -> None:
        """Disconnect from PyBullet."""
        self._engine.close()

    @property
    def is_dynamic(self) -> bool:
        """Whether things move by themselves."""
        return self._engine.is_dynamic

    @property
    def properties(self) -> PhysicsProperties:
        """The physics' numbers."""
        return self._engine.properties

    def set_properties(self, properties: PhysicsProperties) -> None:
        """Compute with other numbers from now on."""
        self._engine.set_properties(properties)

    def spawn(
        self, name: str, assembly: Assembly, pose: np.ndarray, fixed_base: bool = False
    ) -> tuple[str, ...]:
        """Add a model.

        Args:
            name: Name in the world; must be free.
            assembly: What it is made of.
            pose: Pose of the model frame in the world, shape (7,).
            fixed_base: Whether physics does not move its root link.

        Returns:
            A message for each thing left out, and for joints that do not begin at zero.

        Raises:
            DescriptionError: If it cannot be loaded; the world stays as it was.
        """
        if name in self.models:
            raise DescriptionError(f"A model called '{name}' is already there.")
        check_size(assembly.description, self.is_dynamic)
        if not self.is_dynamic:
            assembly = assembly.inside_limits()
        model = Model(name, assembly, pose, fixed_base and self.is_dynamic)
        left_out = self._engine.add(model)
        self.models[name] = model
        self._forget_names()
        if assembly.left_out and not model.link_names:
            left_out += ("nothing is left of the model",)
        if self.is_dynamic and not assembly.static:
            left_out += impossible_inertias(assembly.description.links)
        return assembly.left_out + left_out

    def delete(self, name: str) -> None:
        """Remove a model.

        Raises:
            UnknownNameError: If there is no such model.
        """
        model = self.model(name)
        self.forces.forget(model)
        self.motions.forget(model)
        self._engine.remove(name)
        del self.models[name]
        self._forget_names()

    def step(self) -> None:
        """Compute one time step."""
        time_ns = self.time_ns + self.properties.step_ns
        if self.is_dynamic:
            self.motions.step(time_ns)
            self.forces.apply(self._engine, time_ns)
            self._engine.step()
        with self.lock:
            self.time_ns = time_ns
            if self.is_dynamic:
                self._engine.update_models()
            else:
                self.motions.step(time_ns)
        self.motions.measure(time_ns)

    def set_joint_positions(self, name: str, positions: Mapping[str, float]) -> Report:
        """Teleport joints of a model; it holds them there in ``hold``.

        Args:
            name: The model.
            positions: In [rad] or [m], by joint name.

        Returns:
            What was not obeyed to the letter.

        Raises:
            UnknownNameError: If there is no such model.
            InvalidValueError: If a position is not finite; nothing is changed.
        """
        model = self.model(name)
        report = model.set_positions(positions)
        self._engine.write_joints(model, report.changed)
        self.motions.release(model, model.joint_rows(positions))
        return report

    def set_model_state(
        self, model: Model, pose: np.ndarray, twist: np.ndarray, frame: Frame
    ) -> None:
        """Set pose and velocity of a model; joint positions stay.

        Args:
            model: The model.
            pose: Pose in the frame, shape (7,).
            twist: Velocity for the centers of mass and angular velocity, along the
                frame's axes, shape (6,). Ignored in ``kinematic``, where nothing moves
                by itself.
            frame: The reference frame.
        """
        pose, twist = in_world(frame, pose, twist)
        model.set_state(pose, twist * self.is_dynamic)
        self.motions.release(model, base=True)
        self._engine.write(model)

    def set_root_state(
        self, model: Model, pose: np.ndarray, twist: np.ndarray, tree: int = 0
    ) -> None:
        """Set pose and velocity of a tree by its root link; it moves as one.

        Args:
            model: The model.
            pose: Pose of the root link in the world, shape (7,).
            twist: Velocity of the root link's center of mass and its angular velocity,
                along the world's axes, shape (6,). Ignored in ``kinematic``.
            tree: Which of the model's trees.
        """
        model.set_root_state(pose, twist * self.is_dynamic, tree)
        self.motions.release(model, base=tree == 0)
        self._engine.write(model)

    def set_link_state(
        self, entity: LinkEntity, pose: np.ndarray, twist: np.ndarray
    ) -> Placed | None:
        """Set pose and velocity of a link: a root with its model, others by a joint.

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
        model, joint = entity.model, joint_above(entity)
        if joint is None:
            self.set_root_state(model, pose, twist, model.tree_below(entity.row) or 0)
            return None
        placed = place_link(entity, joint, pose, twist * self.is_dynamic)
        rows = model.joint_rows([placed.joint])
        self.motions.release(model, rows)
        self._engine.write_joints(model, rows)
        return placed

    def set_link_properties(
        self, entity: LinkEntity, inertial: Inertial, has_gravity: bool
    ) -> None:
        """Set mass and gravity of a link; the model's state stays as it is.

        Args:
            entity: The link.
            inertial: Its new mass, center of mass and inertia.
            has_gravity: Whether gravity pulls it.

        Raises:
            DescriptionError: If PyBullet refuses it; nothing is changed.
        """
        model, old = entity.model, entity.link
        model.replace_link(replace(old, inertial=inertial, gravity=has_gravity))
        if inertial == old.inertial:
            self._engine.update_gravity(model)
            return
        try:
            self._engine.replace(model)
        except DescriptionError:
            model.replace_link(old)
            raise

    def set_joint_properties(
        self, entity: JointEntity, numbers: Mapping[str, float]
    ) -> None:
        """Set properties of a joint, by the names that Gazebo has for them.

        ``damping``, ``loStop`` and ``hiStop`` take effect, the others are kept.

        Args:
            entity: The joint.
            numbers: Values by the names of ``gazebo_msgs/ODEJointProperties``.
        """
        entity.model.ode_joints.setdefault(entity.name, {}).update(numbers)
        for body in self._engine.bodies(entity.model):
            body.joints.set_properties(entity.name)

    def reset_models(self) -> None:
        """Return all models to where they were spawned, at rest; joints stay."""
        for model in self.models.values():
            self.motions.forget(model)
            model.return_home()
            self._engine.write(model)

    def reset(self) -> None:
        """Return to time zero, with models and joints as spawned and no forces.

        PyBullet begins afresh, so that a second run equals the first to the last bit.
        """
        self.time_ns = 0
        self.forces = ForceSchedule(self.is_dynamic)
        self.motions = Motions(self._engine, self.motions.fall_limits)
        for model in self.models.values():
            model.reset()
        self._engine.rebuild(self.models.values())

    def contacts(self) -> set[tuple[str, str]]:
        """Find which links touch or overlap now, as ``contacts.find_contacts``."""
        return self._engine.contacts()
