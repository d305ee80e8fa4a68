"""gazebo_ros' services about joints, answered as the real Gazebo does.

What changes the world runs in the simulator's loop, between two steps; what reads it
(get_*) runs beside the loop, while nothing changes.
"""

from __future__ import annotations

import math

import numpy as np
import rospy
from gazebo_msgs.srv import (
    ApplyJointEffort,
    ApplyJointEffortResponse,
    GetJointProperties,
    GetJointPropertiesResponse,
    JointRequest,
    JointRequestResponse,
    SetJointProperties,
    SetJointPropertiesResponse,
    SetModelConfiguration,
    SetModelConfigurationResponse,
)

from g1_description.errors import InvalidValueError, MotionError, UnknownNameError
from g1_description.gazebo.services.base import (
    Services,
    SteppedServices,
    checked,
    remarks,
    time_span,
)
from g1_description.motion.trajectory import Trajectory
from g1_description.msg import ModelTrajectory
from g1_description.robot.assembly import SCOPE
from g1_description.ros.conversions import stamp_from_ns
from g1_description.sim.model import Model
from g1_description.srv import SetModelTrajectory, SetModelTrajectoryResponse

KINDS = {
    "revolute": GetJointPropertiesResponse.REVOLUTE,
    "continuous": GetJointPropertiesResponse.CONTINUOUS,
    "prismatic": GetJointPropertiesResponse.PRISMATIC,
    "fixed": GetJointPropertiesResponse.FIXED,
}


class JointServices(Services):
    """Teleport joints, read them, apply efforts, change their properties."""

    def table(self):
        """List the services: name under the node, type, and what answers."""
        return (
            ("set_model_configuration", SetModelConfiguration, self.set_configuration),
            ("get_joint_properties", GetJointProperties, self.get_properties),
            ("set_joint_properties", SetJointProperties, self.set_properties),
            ("apply_joint_effort", ApplyJointEffort, self.apply_effort),
            ("clear_joint_forces", JointRequest, self.clear_efforts),
        )

    def set_configuration(self, request):
        """Teleport joints."""
        name = request.model_name
        if name not in self._world.models:
            rospy.logerr("SetModelConfiguration: model [%s] does not exist", name)
            return SetModelConfigurationResponse(
                False, "SetModelConfiguration: model does not exist"
            )
        if len(request.joint_names) != len(request.joint_positions):
            return SetModelConfigurationResponse(
                False,
                "SetModelConfiguration: joint name and position list have different "
                "lengths",
            )
        try:
            positions = _unscoped(name, request.joint_names, request.joint_positions)
            report = self._world.set_joint_positions(name, positions)
        except InvalidValueError as error:
            return SetModelConfigurationResponse(
                False, f"SetModelConfiguration: refused, {error}"
            )
        message = self._messages.compose(
            "SetModelConfiguration: success", remarks(self._world.model(name), report)
        )
        return SetModelConfigurationResponse(True, message)

    def get_properties(self, request):
        """Return a joint's kind, damping, position and rate."""
        response = GetJointPropertiesResponse()
        try:
            entity = self._world.entities.joint(request.joint_name)
        except UnknownNameError:
            response.status_message = "GetJointProperties: joint not found"
            return response
        model, joint = entity.model, entity.joint
        response.type = KINDS[joint.kind]
        fixed = entity.row is None
        if not fixed:
            given = model.ode_joints.get(joint.name, {})
            response.damping = [given.get("damping", joint.damping)]
        response.position = [math.nan if fixed else float(model.position[entity.row])]
        response.rate = [0.0 if fixed else float(model.velocity[entity.row])]
        response.success = True
        response.status_message = "GetJointProperties: got properties"
        return response

    def set_properties(self, request):
        """Set a joint's ODE numbers; the first of each list counts."""
        try:
            entity = self._world.entities.joint(request.joint_name)
        except UnknownNameError:
            return SetJointPropertiesResponse(
                False, "SetJointProperties: joint not found"
            )
        config = request.ode_joint_config
        lists = {name: getattr(config, name) for name in config.__slots__}
        numbers = {name: values[0] for name, values in lists.items() if values}
        try:
            for name, number in numbers.items():
                checked(name, [number])
            if numbers.get("damping", 0.0) < 0.0:
                raise InvalidValueError(f"the damping {numbers['damping']} is negative")
        except InvalidValueError as error:
            return SetJointPropertiesResponse(
                False, f"SetJointProperties: refused, {error}"
            )
        self._world.set_joint_properties(entity, numbers)
        return SetJointPropertiesResponse(True, "SetJointProperties: properties set")

    def apply_effort(self, request):
        """Apply an effort to a joint for some time."""
        try:
            entity = self._world.entities.joint(request.joint_name)
        except UnknownNameError:
            return ApplyJointEffortResponse(False, "ApplyJointEffort: joint not found")
        try:
            (effort,) = checked("effort", [request.effort])
        except InvalidValueError as error:
            return ApplyJointEffortResponse(
                False, f"ApplyJointEffort: refused, {error}"
            )
        span = time_span(request.start_time, request.duration, self._world.time_ns)
        self._world.forces.apply_effort(entity, span, float(effort))
        details = [self._no_effect("nothing moves")]
        message = self._messages.compose("ApplyJointEffort: effort set", details)
        return ApplyJointEffortResponse(True, message)

    def clear_efforts(self, request):
        """Clear the efforts on a joint; Gazebo knows only the plain name here."""
        self._world.forces.clear_efforts(request.joint_name)
        return JointRequestResponse()


def _unscoped(model, names, positions):
    """Resolve joint names: ``joint`` wins over ``model::joint``.

    Of equal names the last wins; a name that is neither is kept as it is.
    """
    scope = model + SCOPE
    scoped, plain = {}, {}
    for name, position in zip(names, positions):
        if name.startswith(scope):
            scoped[name[len(scope) :]] = position
        else:
            plain[name] = position
    return {**scoped, **plain}


FAR = 0.3
"""Distance to a first sample from which it is told, in [rad] or [m]."""


class TrajectoryServices(SteppedServices):
    """Let models go through motions, and stop them."""

    def table(self):
        """List the services: name under the node, type, and what answers."""
        return (("set_model_trajectory", SetModelTrajectory, self.set_trajectory),)

    def set_trajectory(self, request):
        """Let a model go through a motion, or stop it."""
        try:
            return self._act(request.trajectory)
        except (InvalidValueError, MotionError, UnknownNameError) as error:
            return SetModelTrajectoryResponse(status_message=str(error))

    def apply(self, message: ModelTrajectory) -> str:
        """Do what a message on the topic wants; return what was not done exactly so.

        Raises:
            InvalidValueError: If that cannot be done; nothing is changed.
        """
        try:
            return self._act(message).status_message
        except (MotionError, UnknownNameError) as error:
            raise InvalidValueError(str(error)) from error

    def _act(self, message: ModelTrajectory) -> SetModelTrajectoryResponse:
        """Do what a message wants."""
        model = self._world.model(message.model_name)
        response = SetModelTrajectoryResponse(success=True)
        if not message.times:
            self._world.motions.stop(model, message.joint_names)
            response.start = stamp_from_ns(self._world.time_ns)
            return response
        trajectory = _trajectory(message)
        start = message.start.to_nsec() or self._next_ns
        is_new = self._world.is_dynamic and start >= self._world.time_ns
        jump = _jump(model, trajectory) if is_new else ""
        report = self._world.motions.play(model, trajectory, start)
        if start <= self._world.time_ns:
            self._world.motions.step(self._world.time_ns)
        details = [*remarks(model, report), jump]
        if trajectory.base_poses is not None and self._world.is_dynamic:
            details.append("the base is left to physics")
        response.status_message = self._messages.compose("", details)
        response.start = stamp_from_ns(start)
        response.clamped, response.ignored = [*report.clamped], report.unknown
        return response

    @property
    def _next_ns(self) -> int:
        """The time at which something set now shows, in [ns]."""
        now = self._world.time_ns
        return now if self._stepper.paused else now + self._world.properties.step_ns


def _jump(model: Model, trajectory: Trajectory) -> str:
    """Say which joint the first sample is far from; empty if none, or if that is meant.

    A single configuration is a command; a later first sample leaves time to go there.
    """
    if len(trajectory.times) == 1 or trajectory.times[0] > 0.0:
        return ""
    first = dict(zip(trajectory.joint_names, trajectory.positions[0].tolist()))
    wanted = np.array([first.get(n, np.nan) for n in model.joint_names])
    wanted = np.minimum(np.maximum(wanted, model.lower), model.upper)
    apart = np.abs(wanted - model.target)
    jumps = {n: d for n, d in zip(model.joint_names, apart.tolist()) if n in first}
    name = max(jumps, key=lambda n: jumps[n], default="")
    if not name or jumps[name] <= FAR:
        return ""
    return (
        f"motors take joints to the first sample at once: {name} is {jumps[name]:.2f} "
        "away from it"
    )


def _trajectory(message: ModelTrajectory) -> Trajectory:
    """Read a motion.

    Raises:
        MotionError: If its numbers are not those of a motion.
    """
    n_samples, n_joints = len(message.times), len(message.joint_names)
    positions = _rows("positions", message.positions, n_samples, n_joints)
    velocities, bases = message.velocities, message.base_poses
    return Trajectory(
        np.array(message.times),
        tuple(message.joint_names),
        positions,
        _rows("velocities", velocities, n_samples, n_joints) if velocities else None,
        _rows("base_poses", bases, n_samples, 7) if bases else None,
    )


def _rows(what: str, numbers, n_samples: int, width: int) -> np.ndarray:
    """Arrange numbers in rows, shape (n_samples, width)."""
    if len(numbers) != n_samples * width:
        raise MotionError(
            f"there are {len(numbers)} {what} for {n_samples} times and {width} columns"
        )
    return np.array(numbers, dtype=float).reshape(n_samples, width)
