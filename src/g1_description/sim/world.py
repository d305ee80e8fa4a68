"""The simulated world: models, lights, time, and the commands that change it.

One thread changes it. Calls between two steps take effect immediately, and the same
calls at the same steps give bit-identical results.
"""

from __future__ import annotations

import threading
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from typing import TypeVar

import numpy as np

from g1_description.errors import (
    DescriptionError,
    InvalidValueError,
    UnknownNameError,
)
from g1_description.motion.motors import Motors
from g1_description.robot.assembly import SCOPE, Assembly
from g1_description.robot.description import Description, Inertial
from g1_description.robot.lumping import impossible_inertias
from g1_description.robot.transform import compose
from g1_description.sdf.world import EMPTY_WORLD, Light, Sdf, read_sdf
from g1_description.sim.anchor import Anchors, Gantries
from g1_description.sim.attachments import Attachments
from g1_description.sim.drives import PdCommand
from g1_description.sim.engine import MAX_STEPS, PhysicsProperties
from g1_description.sim.engines import engine_class
from g1_description.sim.entities import (
    Entities,
    Entity,
    Frame,
    PlacedLink,
    in_world,
    joint_above,
    place_link,
)
from g1_description.sim.forces import ForceSchedule
from g1_description.sim.model import Model, Report
from g1_description.sim.motions import Motions

MAX_LINKS = 1000
"""Maximum number of links of a model, which can still be published at 1 kHz."""

MAX_SHAPES = 1000
"""Maximum number of collision shapes of a model: with 10 000 a step takes minutes."""

_Named = TypeVar("_Named")


class World:
    """Models and lights, in the order of spawning.

    Physics ``kinematic``: models stay exactly where they are set; time runs, contacts
    are computed. ``hold``: full dynamics, motors hold the joints at their last
    positions. ``limp``: full dynamics, no motors.
    """

    def __init__(
        self,
        physics: str = "kinematic",
        properties: PhysicsProperties | None = None,
        content: Sdf | None = None,
        motors: Motors | str | None = None,
        engine: str = "bullet",
    ) -> None:
        """Create a world.

        Args:
            physics: One of ``PHYSICS``.
            properties: The physics properties; by default Gazebo's.
            content: Models and lights; by default a ground plane and a sun. A model
                that cannot be loaded is ignored.
            motors: Motors of the joints in ``hold``, or the name of those of each
                robot's profile, bounded by the robots' files;
                None: those of each robot's profile.
            engine: One of ``ENGINES``, which moves the models in ``hold`` and ``limp``.

        Raises:
            UnknownNameError: If there is no such physics or engine.
        """
        self.models: dict[str, Model] = {}
        self.lights: dict[str, Light] = {}
        self.lock = threading.Lock()
        """For threads that read while another one changes the world. A step locks it
        only while it updates the models; other changes need it, too."""
        self.engine = engine_class(engine)(
            physics, properties or PhysicsProperties(), motors
        )
        self.forces = ForceSchedule(self.is_dynamic)
        """Current and future wrenches and efforts."""
        self.anchors = Anchors(physics)
        """Links that keep their poses while joints move."""
        self.motions = Motions(self.engine, self.anchors)
        """Current and future motions."""
        self.gantries = Gantries(self.engine)
        """Ropes on which models hang; a reset leaves them, from points above them."""
        self.attachments = Attachments(self.engine)
        """Objects that links carry; a reset lets them go."""
        content = content or read_sdf(EMPTY_WORLD)
        self.time_ns = round(content.time * 1e9)
        """Simulated time in [ns]."""
        self.left_out = (*content.left_out, *self._add_content(content))
        """A message for each ignored part of the content."""

    def _add_content(self, content: Sdf) -> list[str]:
        """Add the models and lights of a file; return messages on ignored parts."""
        left_out = []
        for light in content.lights:
            self.add_light(light)
        for model in content.models:
            try:
                for message in self.spawn(model.name, model.assembly, model.pose):
                    left_out.append(f"{model.name}: {message}")
            except DescriptionError as error:
                left_out.append(f"model {model.name} is ignored: {error}".rstrip("."))
        return left_out

    @cached_property
    def entities(self) -> Entities:
        """All entities by name."""
        return Entities(self.models.values(), self.lights.values())

    @cached_property
    def link_names(self) -> tuple[str, ...]:
        """All links as ``model::link``, in the order of ``link_states``."""
        return tuple(
            f"{model.name}{SCOPE}{link}"
            for model in self.models.values()
            for link in model.link_names
        )

    @cached_property
    def model_names(self) -> tuple[str, ...]:
        """All models, in the order of ``model_states``."""
        return tuple(self.models)

    def _forget_names(self) -> None:
        """Invalidate the cached tables of names."""
        for name in ("entities", "link_names", "model_names"):
            self.__dict__.pop(name, None)

    def model(self, name: str) -> Model:
        """Find a model.

        Raises:
            UnknownNameError: If there is none of this name.
        """
        return _named("model", self.models, name)

    def light(self, name: str) -> Light:
        """Find a light.

        Raises:
            UnknownNameError: If there is none of this name.
        """
        return _named("light", self.lights, name)

    def add_light(self, light: Light) -> None:
        """Add a light, or replace the one of its name."""
        self.lights[light.name] = light
        self._forget_names()

    def delete_light(self, name: str) -> None:
        """Remove a light.

        Raises:
            UnknownNameError: If there is no such light.
        """
        del self.lights[self.light(name).name]
        self._forget_names()

    def link_states(self) -> tuple[np.ndarray, np.ndarray]:
        """Collect the states of all links.

        Returns:
            Poses of the link frames in the world, shape (n_links, 7), and twists
            of their origins along the world's axes, shape (n_links, 6).
        """
        models = self.models.values()
        poses = [np.zeros((0, 7)), *(model.poses for model in models)]
        twists = [np.zeros((0, 6)), *(model.twists for model in models)]
        return np.concatenate(poses), np.concatenate(twists)

    def model_states(self) -> tuple[np.ndarray, np.ndarray]:
        """Compute the states of all models.

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

    def close(self) -> None:
        """Release the engine's resources."""
        self.engine.close()

    @property
    def is_dynamic(self) -> bool:
        """Whether physics moves models."""
        return self.engine.is_dynamic

    @property
    def properties(self) -> PhysicsProperties:
        """The physics properties."""
        return self.engine.properties

    def set_properties(self, properties: PhysicsProperties) -> None:
        """Set the properties from the next step on."""
        self.engine.set_properties(properties)

    def spawn(
        self, name: str, assembly: Assembly, pose: np.ndarray, fixed_base: bool = False
    ) -> tuple[str, ...]:
        """Add a model.

        Args:
            name: Name in the world; must be free.
            assembly: Its links and joints, with initial positions.
            pose: Pose of the model frame in the world, shape (7,).
            fixed_base: Whether its root link is fixed.

        Returns:
            A message for each ignored part, and for joints that do not start at zero.

        Raises:
            DescriptionError: If it cannot be loaded; the world stays as it was.
        """
        if name in self.models:
            raise DescriptionError(f"A model '{name}' already exists.")
        _check_size(assembly.description)
        if not self.is_dynamic:
            assembly = assembly.inside_limits()
        model = Model(name, assembly, pose, fixed_base and self.is_dynamic)
        left_out = self.engine.add(model)
        self.models[name] = model
        self._forget_names()
        if assembly.left_out and not model.link_names:
            left_out += ("no part of the model can be simulated",)
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
        self.anchors.forget(model)
        self.gantries.forget(model)
        self.attachments.forget(model)
        self.engine.remove(name)
        del self.models[name]
        self._forget_names()

    def step(self) -> None:
        """Compute one time step."""
        self.advance(1)

    def advance(self, most: int) -> int:
        """Compute time steps, as many as nothing changes between.

        Args:
            most: Their largest number.

        Returns:
            Their number, at least 1.
        """
        now, step_ns = self.time_ns, self.properties.step_ns
        count = min(most, self._steady_steps()) if most > 1 else 1
        first, last = now + step_ns, now + step_ns * count
        if self.is_dynamic:
            self.motions.step(first, count)
            self.forces.apply(self.engine, first, last)
            self.gantries.apply()
            self.engine.advance(count)
        with self.lock:
            self.time_ns = last
            if self.is_dynamic:
                self.engine.update_models()
            else:
                self.motions.step(first, count)
                self.attachments.follow()
        self.motions.measure(first, count)
        return count

    def _steady_steps(self) -> int:
        """Count the steps that can be computed together."""
        now, step_ns = self.time_ns, self.properties.step_ns
        # Where an anchor is depends on the way there.
        if not step_ns or self.gantries or (self.anchors and self.motions):
            return 1
        steps = [MAX_STEPS, self.motions.steady_steps(now)]
        if self.is_dynamic:
            steps.append(self.forces.steady_steps(now, step_ns))
            if self.motions or self.forces or not self.engine.is_resting:
                steps.append(self.engine.steady_steps())
        return int(min(steps))

    def set_joint_positions(self, name: str, positions: Mapping[str, float]) -> Report:
        """Teleport joints of a model; in ``hold`` these are the motors' targets.

        With an anchor the base moves, too.

        Args:
            name: The model.
            positions: In [rad] or [m], by joint name.

        Returns:
            The joints that were ignored, clamped and changed.

        Raises:
            UnknownNameError: If there is no such model.
            InvalidValueError: If a position is not finite; nothing is changed.
        """
        model = self.model(name)
        report = model.set_positions(positions)
        rows = model.joint_rows(positions)
        self.engine.write_joints(model, report.changed)
        self.engine.hold(model, rows)
        self.motions.release(model, rows)
        if not self.motions.moves_base(model):
            self.anchors.hold(model)
        self.attachments.renew(model)
        return report

    def drive(
        self, model: Model, names: Sequence[str], command: PdCommand
    ) -> list[str]:
        """Let a controller drive joints of a model, from the next step on.

        It does until they get targets, a motion or another command; a motion that they
        have ends.

        Args:
            model: The model.
            names: Names of joints.
            command: The command to them, in this order.

        Returns:
            The names of joints that the model does not have, which are ignored.

        Raises:
            InvalidValueError: In ``kinematic`` physics; nothing is changed.
        """
        if not self.is_dynamic:
            raise InvalidValueError("nothing drives the joints in kinematic physics")
        rows = [model.joint_row(name) for name in names]
        known = [number for number, row in enumerate(rows) if row is not None]
        own = np.array([rows[number] for number in known], dtype=int)
        if len(known) < len(rows):
            command = PdCommand(*(part[known] for part in command))
        self.engine.drive(model, own, command)
        has_target = command.stiffness > 0.0
        model.commanded[own] = np.where(has_target, command.positions, np.nan)
        model.commanded_base = None  # unless a motion still has one
        self.motions.release(model, own.tolist())
        return [name for name, row in zip(names, rows) if row is None]

    def set_model_state(
        self, model: Model, pose: np.ndarray, twist: np.ndarray, frame: Frame
    ) -> None:
        """Set pose and velocity of a model; joint positions stay.

        Args:
            model: The model.
            pose: Pose in the frame, shape (7,).
            twist: Velocity for the centers of mass and angular velocity, along the
                frame's axes, shape (6,). Ignored in ``kinematic``.
            frame: The reference frame.
        """
        pose, twist = in_world(frame, pose, twist)
        model.set_state(pose, twist * self.is_dynamic)
        self._command_base(model)
        self.motions.release(model, base=True)
        self.anchors.renew(model)
        self.gantries.renew(model)
        self.engine.write(model)
        self.attachments.renew(model)

    def _command_base(self, model: Model) -> None:
        """Command a base to be where it is, if it would stay there."""
        is_held = bool(model.trees) and not self.is_dynamic
        model.commanded_base = model.root_poses[0].copy() if is_held else None

    def set_root_state(
        self, model: Model, pose: np.ndarray, twist: np.ndarray, tree: int = 0
    ) -> None:
        """Set pose and velocity of a tree by its root link; it moves rigidly.

        Args:
            model: The model.
            pose: Pose of the root link in the world, shape (7,).
            twist: Velocity of the root link's center of mass and its angular velocity,
                along the world's axes, shape (6,). Ignored in ``kinematic``.
            tree: Index of the tree.
        """
        model.set_root_state(pose, twist * self.is_dynamic, tree)
        if tree == 0:
            self._command_base(model)
        self.motions.release(model, base=tree == 0)
        self.anchors.renew(model)
        self.gantries.renew(model)
        self.engine.write(model)
        self.attachments.renew(model)

    def set_link_state(
        self, entity: Entity, pose: np.ndarray, twist: np.ndarray
    ) -> PlacedLink | None:
        """Set pose and velocity of a link: a root with its model, others by a joint.

        Args:
            entity: The link.
            pose: Pose in the world, shape (7,).
            twist: Velocity of its center of mass and its angular velocity, along the
                world's axes, shape (6,). Ignored in ``kinematic``.

        Returns:
            The remaining distance, for a link that is not a root.

        Raises:
            InvalidValueError: If it is fixed to another link; nothing is changed.
        """
        model, joint = entity.model, joint_above(entity)
        if joint is None:
            roots = [tree.root_row for tree in model.trees]
            tree = roots.index(entity.row) if entity.row in roots else 0
            self.set_root_state(model, pose, twist, tree)
            return None
        placed = place_link(entity, joint, pose, twist * self.is_dynamic)
        rows = model.joint_rows([placed.joint])
        self.motions.release(model, rows)
        self.anchors.renew(model)
        self.engine.write_joints(model, rows)
        self.engine.hold(model, rows)
        self.attachments.renew(model)
        return placed

    def set_link_properties(
        self, entity: Entity, inertial: Inertial, has_gravity: bool
    ) -> None:
        """Set mass and gravity of a link; the model's state stays as it is.

        Args:
            entity: The link.
            inertial: Its new mass, center of mass and inertia.
            has_gravity: Whether gravity pulls it.

        Raises:
            DescriptionError: If the engine refuses it; nothing is changed.
        """
        model, old = entity.model, entity.link
        model.replace_link(replace(old, inertial=inertial, gravity=has_gravity))
        if inertial == old.inertial:
            self.engine.update_gravity(model)
            return
        try:
            self.engine.replace(model)
        except DescriptionError:
            model.replace_link(old)
            raise

    def set_joint_properties(
        self, entity: Entity, numbers: Mapping[str, float]
    ) -> None:
        """Set properties of a joint, by Gazebo's names.

        ``damping``, ``loStop`` and ``hiStop`` take effect, the others are stored.

        Args:
            entity: The joint.
            numbers: Values by the names of ``gazebo_msgs/ODEJointProperties``.
        """
        entity.model.ode_joints.setdefault(entity.name, {}).update(numbers)
        self.engine.update_joint(entity.model, entity.name)

    def reset_models(self) -> None:
        """Reset all models to their poses at spawning, at rest; joints stay."""
        self.attachments.clear()
        for model in self.models.values():
            self.motions.forget(model)
            model.return_home()
            self.anchors.renew(model)
            self.gantries.renew(model)
            self.engine.write(model)

    def reset(self) -> None:
        """Reset time to zero, models and joints as spawned, without forces.

        The engine is rebuilt, so that a second run is bit-identical to the first.
        """
        self.time_ns = 0
        self.attachments.clear()
        self.forces = ForceSchedule(self.is_dynamic)
        self.motions = Motions(self.engine, self.anchors, self.motions.fall_limits)
        for model in self.models.values():
            model.reset()
            self.anchors.renew(model)
            self.gantries.renew(model)
        self.engine.rebuild(self.models.values())


def _named(kind: str, things: Mapping[str, _Named], name: str) -> _Named:
    """Find a model or light by its name.

    Raises:
        UnknownNameError: If there is none.
    """
    if name not in things:
        raise UnknownNameError(
            f"There is no {kind} '{name}'; there are {', '.join(things) or 'none'}."
        )
    return things[name]


def _check_size(description: Description) -> None:
    """Refuse a model that is too large.

    Raises:
        DescriptionError: If it has too many links or shapes.
    """
    links = len(description.links)
    if links > MAX_LINKS:
        raise DescriptionError(
            f"Robot '{description.name}' must have at most {MAX_LINKS} links, without "
            f"those on fixed joints (got {links})."
        )
    shapes = sum(len(link.collisions) for link in description.links)
    if shapes > MAX_SHAPES:
        raise DescriptionError(
            f"Robot '{description.name}' must have at most {MAX_SHAPES} collision "
            f"shapes (got {shapes})."
        )
