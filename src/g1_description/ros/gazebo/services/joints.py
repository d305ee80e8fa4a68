"""gazebo_ros' services about joints, answered as the real Gazebo does.

What changes the world runs in the simulator's loop, between two steps; what reads it
(get_*) runs beside the loop, while nothing changes.
"""

from __future__ import annotations

import math

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

from g1_description.core.errors import InvalidValueError, UnknownNameError
from g1_description.core.robot.assembly import SCOPE
from g1_description.sim.model import Model, Report

from .base import Services, checked, clamped, time_span

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
            "SetModelConfiguration: success", _details(self._world.model(name), report)
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


def _details(model: Model, report: Report) -> list[str]:
    """List what was not done exactly as requested."""
    details = []
    if report.unknown:
        names = ", ".join(name or "''" for name in report.unknown)
        details.append(f"ignored, no movable joint of {model.name}: {names}")
    return [*details, clamped(model, report)]
