"""gazebo_ros' services about physics and lights, answered as the real Gazebo does.

Services that change the world run in the simulator's loop, between two steps; the
others (get_*) run outside of the loop, while nothing changes.
"""

from __future__ import annotations

import math
from dataclasses import fields, replace

from gazebo_msgs.msg import ODEPhysics
from gazebo_msgs.srv import (
    DeleteLight,
    GetLightProperties,
    GetLightPropertiesResponse,
    GetPhysicsProperties,
    GetPhysicsPropertiesResponse,
    SetLightProperties,
    SetPhysicsProperties,
)
from std_msgs.msg import ColorRGBA

from g1_description.errors import InvalidValueError
from g1_description.gazebo.services.base import (
    RefusalError,
    Simulation,
    checked,
    checked_pose,
    found,
)
from g1_description.ros.conversions import vector_to_array
from g1_description.sim.engine import GRAVITY_AXES, PhysicsProperties
from g1_description.srv import SetRealTimeFactor

UNSETTABLE = ("auto_disable_bodies", "sor_pgs_rms_error_tol")
"""Properties that Gazebo ignores when set."""

ODE = tuple(ODEPhysics.__slots__)


ATTENUATION = ("constant", "linear", "quadratic")
"""Attenuation coefficients of a light."""


def get_physics(simulation: Simulation, _):
    """Return the physics properties."""
    properties = simulation.world.properties
    response = GetPhysicsPropertiesResponse(
        time_step=properties.time_step,
        pause=simulation.stepper.paused,
        max_update_rate=properties.max_update_rate,
        success=True,
        status_message="GetPhysicsProperties: got properties",
    )
    gravity = response.gravity
    gravity.x, gravity.y, gravity.z = properties.gravity
    for name in ODE:
        setattr(response.ode_config, name, getattr(properties, name))
    return response


def set_physics(simulation: Simulation, request):
    """Set the physics properties."""
    gravity = vector_to_array(request.gravity).tolist()
    numbers = {
        "time_step": request.time_step,
        "max_update_rate": request.max_update_rate,
        **dict(zip(GRAVITY_AXES, gravity)),
        **{name: getattr(request.ode_config, name) for name in ODE},
    }
    change_physics(simulation, numbers)
    frozen = "" if request.time_step else "time stands still, time_step is 0"
    return simulation.message("physics engine updated", frozen)


def change_physics(simulation: Simulation, numbers) -> None:
    """Set the physics properties that Gazebo does not ignore.

    Args:
        simulation: The world and its services' state.
        numbers: Values by the names of ``PhysicsProperties``.

    Raises:
        InvalidValueError: If one is out of its range; nothing is changed.
    """
    world = simulation.world
    known = {field.name for field in fields(PhysicsProperties)} - {*UNSETTABLE}
    settable = {name: value for name, value in numbers.items() if name in known}
    world.set_properties(replace(world.properties, **settable))
    if not world.properties.step_ns:
        simulation.stepper.end("a time_step of 0")


def set_real_time_factor(simulation: Simulation, request):
    """Set how fast simulated time runs, by max_update_rate."""
    factor, step = request.real_time_factor, simulation.world.properties.time_step
    if not (math.isfinite(factor) and factor >= 0.0 and step > 0.0):
        raise InvalidValueError(
            "the factor must be at least 0 (as fast as possible) and time_step greater "
            f"than 0 (got {factor} and {step})"
        )
    rate = factor / step
    change_physics(simulation, {"max_update_rate": rate})
    return f"SetRealTimeFactor: max_update_rate is {rate:g} Hz"


def get_light(simulation: Simulation, request):
    """Return a light's color and attenuation."""
    light = _light(simulation, request, "getLight")
    names = [f"attenuation_{name}" for name in ATTENUATION]
    return GetLightPropertiesResponse(
        diffuse=ColorRGBA(*light.diffuse),
        **{name: getattr(light, name) for name in names},
        success=True,
        status_message="",
    )


def _light(simulation: Simulation, request, service: str):
    """Find the light of a request."""
    name = request.light_name
    message = f"{service}Properties: Requested light {name} not found!"
    return found(simulation.world.light, name, message)


def set_light(simulation: Simulation, request):
    """Change a light."""
    light = _light(simulation, request, "setLight")
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
        raise RefusalError(f"setLightProperties: refused, {error}") from error
    simulation.world.add_light(
        replace(
            light,
            cast_shadows=request.cast_shadows,
            pose=pose,
            direction=tuple(direction.tolist()),
            **colors,
            **attenuation,
        )
    )
    return ""


def _color(request, name: str) -> tuple[float, ...]:
    """Read a color."""
    color = getattr(request, name)
    return tuple(checked(name, [color.r, color.g, color.b, color.a]).tolist())


def delete_light(simulation: Simulation, request):
    """Remove a light."""
    name, world = request.light_name, simulation.world
    missing = f'DeleteLight: Timeout reached while removing light "{name}"'
    found(world.delete_light, name, missing)
    return f"DeleteLight: {name} successfully deleted"


SERVICES = (
    ("get_physics_properties", GetPhysicsProperties, get_physics),
    ("set_physics_properties", SetPhysicsProperties, set_physics),
    ("set_real_time_factor", SetRealTimeFactor, set_real_time_factor),
    ("get_light_properties", GetLightProperties, get_light),
    ("set_light_properties", SetLightProperties, set_light),
    ("delete_light", DeleteLight, delete_light),
)
"""Name under the node, type, and the function that answers."""
