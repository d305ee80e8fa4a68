"""gazebo_ros' services about physics and lights, answered as the real Gazebo does.

Physics is offered through dynamic_reconfigure, too, as there.

Services that change the world run in the simulator's loop, between two steps; the
others (get_*) run outside of the loop, while nothing changes.
"""

from __future__ import annotations

import math
from dataclasses import fields, replace
from types import SimpleNamespace

import rospy
from dynamic_reconfigure.encoding import encode_config
from dynamic_reconfigure.server import Server
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

from g1_description.errors import G1DescriptionError, InvalidValueError
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
        colors = {}
        for name in ("diffuse", "specular"):
            color = getattr(request, name)
            parts = checked(name, [color.r, color.g, color.b, color.a])
            colors[name] = tuple(parts.tolist())
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


def delete_light(simulation: Simulation, request):
    """Remove a light."""
    name, world = request.light_name, simulation.world
    missing = f'DeleteLight: Timeout reached while removing light "{name}"'
    found(world.delete_light, name, missing)
    return f"DeleteLight: {name} successfully deleted"


def reconfigure(simulation: Simulation, numbers: dict) -> dict:
    """Change physics properties; return the current ones if that is refused."""
    try:
        change_physics(simulation, numbers)
    except G1DescriptionError as error:
        rospy.logerr("set_parameters: refused, %s", error)
        properties, kept = simulation.world.properties, {*UNSETTABLE}
        return {n: getattr(properties, n) for n in numbers if n not in kept}
    rospy.loginfo("physics dynamics reconfigure update complete")
    rospy.loginfo("physics dynamics reconfigure complete")
    return {}


RANGES = {
    "time_step": (0.0, 10.0),
    "max_update_rate": (0.0, 1000.0),
    "gravity_x": (-100.0, 100.0),
    "gravity_y": (-100.0, 100.0),
    "gravity_z": (-100.0, 100.0),
    "auto_disable_bodies": (False, True),
    "sor_pgs_precon_iters": (0, 10_000),
    "sor_pgs_iters": (0, 10_000),
    "sor_pgs_w": (0.0, 5.0),
    "sor_pgs_rms_error_tol": (-1.0, 10_000.0),
    "cfm": (0.0, 10.0),
    "erp": (0.0, 10.0),
    "contact_surface_layer": (0.0, 10.0),
    "contact_max_correcting_vel": (0.0, 1e7),
    "max_contacts": (0, 10_000_000),
}
"""Range of each property, in Gazebo's order."""

DEFAULTS = {
    "time_step": 0.001,
    "max_update_rate": 60.0,
    "gravity_x": 0.0,
    "gravity_y": 0.0,
    "gravity_z": -9.8,
    "auto_disable_bodies": False,
    "sor_pgs_precon_iters": 0,
    "sor_pgs_iters": 20,
    "sor_pgs_w": 1.3,
    "sor_pgs_rms_error_tol": -1.0,
    "cfm": 0.0,
    "erp": 0.2,
    "contact_surface_layer": 0.001,
    "contact_max_correcting_vel": 100.0,
    "max_contacts": 100,
}
"""Defaults that gazebo_ros reports. They are not Gazebo's initial values."""

GROUP = {"name": "Default", "state": True, "id": 0, "parent": 0}
"""The only group, with all properties."""

_KINDS = {float: "double", int: "int", bool: "bool"}
_MEANINGS = {
    "time_step": "Length of a physics step in [s]",
    "max_update_rate": "Steps per second of wall time, 0: as fast as possible",
}


def _configuration() -> SimpleNamespace:
    """Return the equivalent of a generated module, for dynamic_reconfigure's server."""
    groups = {"groups": {**GROUP, "groups": {}}}
    kinds = {name: _KINDS[type(low)] for name, (low, _) in RANGES.items()}
    parameters = [
        {
            "name": name,
            "type": kinds[name],
            "level": 1,
            "description": _MEANINGS.get(name, name.replace("_", " ")),
            "edit_method": "",
            "default": DEFAULTS[name],
            "min": low,
            "max": high,
        }
        for name, (low, high) in RANGES.items()
    ]
    return SimpleNamespace(
        defaults={**DEFAULTS, **groups},
        min={**{name: low for name, (low, _) in RANGES.items()}, **groups},
        max={**{name: high for name, (_, high) in RANGES.items()}, **groups},
        type=kinds,
        config_description={
            **GROUP,
            "type": "",
            "groups": [],
            "parameters": parameters,
        },
    )


class _PhysicsServer(Server):
    """A server that ignores groups; the library fails on unknown ones."""

    def _set_callback(self, request):
        """Change known properties of the right type; ignore the rest."""
        config = request.config
        kinds = (("bool", config.bools), ("int", config.ints))
        given = {
            entry.name: entry.value
            for kind, entries in (*kinds, ("double", config.doubles))
            for entry in entries
            if self.type.type.get(entry.name) == kind
        }
        return encode_config(self.update_configuration(given))


def offer_physics(properties: PhysicsProperties, change) -> Server:
    """Start the server under the node's own name.

    Args:
        properties: Initial properties.
        change: Called with a dict of all properties after a change; returns those with
            other values.
    """
    current = {name: getattr(properties, name) for name in RANGES}
    server = None

    def changed(values, _):
        # The server's constructor calls this with defaults that do not apply.
        if server is None:
            values.update(current)
            return values
        kinds = {name: type(low) for name, (low, _) in RANGES.items()}
        numbers = {name: kind(values[name]) for name, kind in kinds.items()}
        values.update(change(numbers))
        return values

    server = _PhysicsServer(_configuration(), changed)
    return server


SERVICES = (
    ("get_physics_properties", GetPhysicsProperties, get_physics),
    ("set_physics_properties", SetPhysicsProperties, set_physics),
    ("set_real_time_factor", SetRealTimeFactor, set_real_time_factor),
    ("get_light_properties", GetLightProperties, get_light),
    ("set_light_properties", SetLightProperties, set_light),
    ("delete_light", DeleteLight, delete_light),
)
"""Name under the node, type, and the function that answers."""
