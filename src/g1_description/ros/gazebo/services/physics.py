"""Services that read and change the physics' numbers, as the real Gazebo does.

What changes the world runs in the simulator's loop, between two steps; what reads it
(get_*) runs beside the loop, while nothing changes.
"""

from __future__ import annotations

import math
from dataclasses import fields, replace

from gazebo_msgs.msg import ODEPhysics
from gazebo_msgs.srv import (
    GetPhysicsProperties,
    GetPhysicsPropertiesResponse,
    SetPhysicsProperties,
    SetPhysicsPropertiesResponse,
)

from g1_description.core.errors import InvalidValueError
from g1_description.ros.wire.conversions import vector_to_array
from g1_description.sim.physics import GRAVITY, PhysicsProperties
from g1_description.srv import SetRealTimeFactor, SetRealTimeFactorResponse

from .base import SteppedServices

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
