"""Services about time, physics and lights, answered as the real Gazebo does.

Everything here runs in the simulator's loop, between two steps.
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
from std_srvs.srv import Empty, EmptyResponse

from g1_description.core.errors import InvalidValueError, UnknownNameError
from g1_description.ros.gazebo.stepper import Stepper
from g1_description.ros.wire.messages import vector_to_array
from g1_description.sim.physics import GRAVITY, PhysicsProperties
from g1_description.sim.world import World
from g1_description.srv import (
    SetRealTimeFactor,
    SetRealTimeFactorResponse,
)

from .base import Services, Wording, checked, checked_pose

UNSETTABLE = ("auto_disable_bodies", "sor_pgs_rms_error_tol")
"""Numbers that Gazebo reads and never sets."""

FADING = ("constant", "linear", "quadratic")
"""How a light fades with the distance."""

ODE = tuple(ODEPhysics.__slots__)


class WorldServices(Services):
    """Pause and go on, begin again, change physics and lights."""

    def __init__(self, world: World, wording: Wording, stepper: Stepper) -> None:
        """Serve a world.

        Args:
            world: What the services act on.
            wording: How much they say.
            stepper: Whether time runs.
        """
        super().__init__(world, wording)
        self._stepper = stepper

    def table(self):
        """List the services: name under the node, type, and what answers."""
        return (
            ("pause_physics", Empty, self.pause),
            ("unpause_physics", Empty, self.unpause),
            ("reset_simulation", Empty, self.reset_simulation),
            ("reset_world", Empty, self.reset_world),
            ("get_physics_properties", GetPhysicsProperties, self.get_physics),
            ("set_physics_properties", SetPhysicsProperties, self.set_physics),
            ("get_light_properties", GetLightProperties, self.get_light),
            ("set_light_properties", SetLightProperties, self.set_light),
            ("delete_light", DeleteLight, self.delete_light),
            ("set_real_time_factor", SetRealTimeFactor, self.set_real_time_factor),
        )

    def pause(self, _):
        """Let time stand still, also where steps were asked for."""
        self._stepper.paused = True
        self._stepper.end("pause_physics")
        return EmptyResponse()

    def unpause(self, _):
        """Let time run."""
        self._stepper.paused = False
        return EmptyResponse()

    def reset_simulation(self, _):
        """Begin again: time zero, models as spawned, joints at zero."""
        self._world.reset()
        self._stepper.end("reset_simulation")
        return EmptyResponse()

    def reset_world(self, _):
        """Put the models back where they were spawned, joints as they are."""
        self._world.reset_models()
        self._stepper.end("reset_world")
        return EmptyResponse()

    def get_physics(self, _):
        """Tell the physics' numbers."""
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
            words = f"SetPhysicsProperties: refused, {error}"
            return SetPhysicsPropertiesResponse(False, words)
        frozen = "" if request.time_step else "time stands still, time_step is 0"
        words = self._wording.say("physics engine updated", [frozen])
        return SetPhysicsPropertiesResponse(True, words)

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

    def get_light(self, request):
        """Tell a light's color and how it fades."""
        response = GetLightPropertiesResponse()
        try:
            light = self._world.light(request.light_name)
        except UnknownNameError:
            response.status_message = _no_light("getLight", request)
            return response
        response.diffuse = ColorRGBA(*light.diffuse)
        for name in FADING:
            attenuation = f"attenuation_{name}"
            setattr(response, attenuation, getattr(light, attenuation))
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
            fading = {
                f"attenuation_{name}": float(
                    checked(name, [getattr(request, f"attenuation_{name}")])[0]
                )
                for name in FADING
            }
        except InvalidValueError as error:
            words = f"setLightProperties: refused, {error}"
            return SetLightPropertiesResponse(False, words)
        self._world.add_light(
            replace(
                light,
                cast_shadows=request.cast_shadows,
                pose=pose,
                direction=tuple(direction.tolist()),
                **colors,
                **fading,
            )
        )
        return SetLightPropertiesResponse(True, "")

    def delete_light(self, request):
        """Remove a light."""
        name = request.light_name
        try:
            self._world.delete_light(name)
        except UnknownNameError:
            words = f'DeleteLight: Timeout reached while removing light "{name}"'
            return DeleteLightResponse(False, words)
        return DeleteLightResponse(True, f"DeleteLight: {name} successfully deleted")

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


def _no_light(what: str, request) -> str:
    """Say that there is no such light, as Gazebo does."""
    return f"{what}Properties: Requested light {request.light_name} not found!"


def _color(request, name: str) -> tuple[float, ...]:
    """Read a color."""
    color = getattr(request, name)
    return tuple(checked(name, [color.r, color.g, color.b, color.a]).tolist())
