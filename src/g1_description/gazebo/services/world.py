"""Services that read and change the physics' numbers, as the real Gazebo does.

What changes the world runs in the simulator's loop, between two steps; what reads it
(get_*) runs beside the loop, while nothing changes.
"""

from __future__ import annotations

import math
from dataclasses import fields, replace

from gazebo_msgs.msg import ODEPhysics
from gazebo_msgs.srv import (
    DeleteLight,
    DeleteLightResponse,
    GetLightProperties,
    GetLightPropertiesResponse,
    GetPhysicsProperties,
    GetPhysicsPropertiesResponse,
    SetLightProperties,
    SetLightPropertiesResponse,
    SetPhysicsProperties,
    SetPhysicsPropertiesResponse,
)
from std_msgs.msg import ColorRGBA

from g1_description.errors import InvalidValueError, UnknownNameError
from g1_description.gazebo.services.base import (
    Services,
    SteppedServices,
    checked,
    checked_pose,
)
from g1_description.ros.conversions import vector_to_array
from g1_description.sim.engine import GRAVITY, PhysicsProperties
from g1_description.srv import SetRealTimeFactor, SetRealTimeFactorResponse

UNSETTABLE = ("auto_disable_bodies", "sor_pgs_rms_error_tol")
"""Numbers that Gazebo reads and never sets."""

ODE = tuple(ODEPhysics.__slots__)


class PhysicsServices(SteppedServices):
    """Read and change the physics' numbers and the speed of time."""

    def table(self):
        """List the services: name under the node, type, and what answers."""
        return (
            ("get_physics_properties", GetPhysicsProperties, self.get_physics),
            ("set_physics_properties", SetPhysicsProperties, self.set_physics),
            ("set_real_time_factor", SetRealTimeFactor, self.set_real_time_factor),
        )

    def get_physics(self, _):
        """Return the physics' numbers."""
        properties = self._world.properties
        response = GetPhysicsPropertiesResponse(
            time_step=properties.time_step,
            pause=self._stepper.paused,
            max_update_rate=properties.max_update_rate,
            success=True,
            status_message="GetPhysicsProperties: got properties",
        )
        gravity = response.gravity
        gravity.x, gravity.y, gravity.z = properties.gravity
        for name in ODE:
            setattr(response.ode_config, name, getattr(properties, name))
        return response

    def set_physics(self, request):
        """Change the physics' numbers."""
        gravity = vector_to_array(request.gravity).tolist()
        numbers = {
            "time_step": request.time_step,
            "max_update_rate": request.max_update_rate,
            **dict(zip(GRAVITY, gravity)),
            **{name: getattr(request.ode_config, name) for name in ODE},
        }
        try:
            self.change_physics(numbers)
        except InvalidValueError as error:
            message = f"SetPhysicsProperties: refused, {error}"
            return SetPhysicsPropertiesResponse(False, message)
        frozen = "" if request.time_step else "time stands still, time_step is 0"
        message = self._messages.compose("physics engine updated", [frozen])
        return SetPhysicsPropertiesResponse(True, message)

    def change_physics(self, numbers) -> None:
        """Change the physics' numbers that Gazebo sets.

        Args:
            numbers: Values by the names of ``PhysicsProperties``.

        Raises:
            InvalidValueError: If one is out of its range; nothing is changed.
        """
        known = {field.name for field in fields(PhysicsProperties)} - {*UNSETTABLE}
        settable = {name: value for name, value in numbers.items() if name in known}
        self._world.set_properties(replace(self._world.properties, **settable))
        if not self._world.properties.step_ns:
            self._stepper.end("a time_step of 0")

    def set_real_time_factor(self, request):
        """Set how fast simulated time runs, by max_update_rate."""
        factor, step = request.real_time_factor, self._world.properties.time_step
        if not (math.isfinite(factor) and factor >= 0.0 and step > 0.0):
            return SetRealTimeFactorResponse(
                False,
                f"SetRealTimeFactor: refused, factor {factor} at time_step {step}; "
                "the factor must be 0 (as fast as can be) or more, the step above 0",
            )
        try:
            self.change_physics({"max_update_rate": factor / step})
        except InvalidValueError as error:
            return SetRealTimeFactorResponse(
                False, f"SetRealTimeFactor: refused, {error}"
            )
        return SetRealTimeFactorResponse(
            True, f"SetRealTimeFactor: max_update_rate is {factor / step:g} Hz"
        )


ATTENUATION = ("constant", "linear", "quadratic")
"""Coefficients of how a light fades with distance."""


class LightServices(Services):
    """Read, change and delete lights."""

    def table(self):
        """List the services: name under the node, type, and what answers."""
        return (
            ("get_light_properties", GetLightProperties, self.get_light),
            ("set_light_properties", SetLightProperties, self.set_light),
            ("delete_light", DeleteLight, self.delete_light),
        )

    def get_light(self, request):
        """Return a light's color and attenuation."""
        response = GetLightPropertiesResponse()
        try:
            light = self._world.light(request.light_name)
        except UnknownNameError:
            response.status_message = _no_light("getLight", request)
            return response
        response.diffuse = ColorRGBA(*light.diffuse)
        for name in ATTENUATION:
            coefficient = f"attenuation_{name}"
            setattr(response, coefficient, getattr(light, coefficient))
        response.success = True
        return response

    def set_light(self, request):
        """Change a light."""
        try:
            light = self._world.light(request.light_name)
        except UnknownNameError:
            return SetLightPropertiesResponse(False, _no_light("setLight", request))
        try:
            pose = checked_pose(request.pose)
            direction = checked("direction", vector_to_array(request.direction))
            colors = {name: _color(request, name) for name in ("diffuse", "specular")}
            attenuation = {
                f"attenuation_{name}": float(
                    checked(name, [getattr(request, f"attenuation_{name}")])[0]
                )
                for name in ATTENUATION
            }
        except InvalidValueError as error:
            message = f"setLightProperties: refused, {error}"
            return SetLightPropertiesResponse(False, message)
        self._world.add_light(
            replace(
                light,
                cast_shadows=request.cast_shadows,
                pose=pose,
                direction=tuple(direction.tolist()),
                **colors,
                **attenuation,
            )
        )
        return SetLightPropertiesResponse(True, "")

    def delete_light(self, request):
        """Remove a light."""
        name = request.light_name
        try:
            self._world.delete_light(name)
        except UnknownNameError:
            message = f'DeleteLight: Timeout reached while removing light "{name}"'
            return DeleteLightResponse(False, message)
        return DeleteLightResponse(True, f"DeleteLight: {name} successfully deleted")


def _no_light(what: str, request) -> str:
    """Say that there is no such light, as Gazebo does."""
    return f"{what}Properties: Requested light {request.light_name} not found!"


def _color(request, name: str) -> tuple[float, ...]:
    """Read a color."""
    color = getattr(request, name)
    return tuple(checked(name, [color.r, color.g, color.b, color.a]).tolist())
