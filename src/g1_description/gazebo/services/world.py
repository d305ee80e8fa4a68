"""gazebo_ros' services about physics, lights and time, answered as Gazebo does.

Physics is offered through dynamic_reconfigure, too, as there.
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
from std_srvs.srv import Empty

from g1_description.errors import (
    G1DescriptionError,
    InvalidValueError,
    UnknownNameError,
)
from g1_description.gazebo.services.base import (
    RefusalError,
    Simulation,
    checked,
    checked_pose,
    found,
    remarks,
)
from g1_description.ros.conversions import (
    pose_from_array,
    stamp_from_ns,
    twist_from_array,
    vector_to_array,
)
from g1_description.sim.engine import GRAVITY_AXES, PhysicsProperties
from g1_description.sim.model import Model, Report
from g1_description.sim.world import World
from g1_description.srv import (
    SetRealTimeFactor,
    Step,
    StepModel,
    StepModelResponse,
    StepResponse,
)
from g1_description.text import listed, similar_first

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


RECONFIGURABLE = {
    "time_step": (0.0, 10.0, 0.001),
    "max_update_rate": (0.0, 1000.0, 60.0),
    "gravity_x": (-100.0, 100.0, 0.0),
    "gravity_y": (-100.0, 100.0, 0.0),
    "gravity_z": (-100.0, 100.0, -9.8),
    "auto_disable_bodies": (False, True, False),
    "sor_pgs_precon_iters": (0, 10_000, 0),
    "sor_pgs_iters": (0, 10_000, 20),
    "sor_pgs_w": (0.0, 5.0, 1.3),
    "sor_pgs_rms_error_tol": (-1.0, 1e4, -1.0),
    "cfm": (0.0, 10.0, 0.0),
    "erp": (0.0, 10.0, 0.2),
    "contact_surface_layer": (0.0, 10.0, 0.001),
    "contact_max_correcting_vel": (0.0, 1e7, 100.0),
    "max_contacts": (0, 10_000_000, 100),
}
"""Range and default of each property that gazebo_ros reports, in Gazebo's order. The
defaults are not Gazebo's initial values."""

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
    names, rows = [*RECONFIGURABLE], zip(*RECONFIGURABLE.values())
    lows, highs, defaults = (dict(zip(names, row)) for row in rows)
    kinds = {name: _KINDS[type(low)] for name, low in lows.items()}
    parameters = [
        {
            "name": name,
            "type": kinds[name],
            "level": 1,
            "description": _MEANINGS.get(name, name.replace("_", " ")),
            "edit_method": "",
            "default": default,
            "min": low,
            "max": high,
        }
        for name, (low, high, default) in RECONFIGURABLE.items()
    ]
    return SimpleNamespace(
        defaults={**defaults, **groups},
        min={**lows, **groups},
        max={**highs, **groups},
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
    current = {name: getattr(properties, name) for name in RECONFIGURABLE}
    server = None

    def changed(values, _):
        # The server's constructor calls this with defaults that do not apply.
        if server is None:
            values.update(current)
            return values
        numbers = {n: type(r[0])(values[n]) for n, r in RECONFIGURABLE.items()}
        values.update(change(numbers))
        return values

    server = _PhysicsServer(_configuration(), changed)
    return server


def pause(simulation: Simulation, _):
    """Pause time; requested steps are aborted."""
    simulation.stepper.paused = True
    simulation.stepper.end("pause_physics")


def unpause(simulation: Simulation, _):
    """Resume time."""
    simulation.stepper.paused = False


def reset_simulation(simulation: Simulation, _):
    """Reset time to zero, and models and joints as spawned."""
    simulation.world.reset()
    simulation.stepper.end("reset_simulation")


def reset_world(simulation: Simulation, _):
    """Reset the poses of models; joints keep their positions."""
    simulation.world.reset_models()
    simulation.stepper.end("reset_world")


def step(simulation: Simulation, request):
    """Step; answered after the last step. Not in Gazebo."""

    def respond(success, outcome):
        return StepResponse(success, f"Step: {outcome}")

    _check_steps(simulation, "Step", request.steps)
    if not request.steps:
        return respond(True, "0 steps done")
    return simulation.stepper.request(request.steps, respond)


def step_model(simulation: Simulation, request):
    """Set a model, step, and answer with its state. Not in Gazebo."""
    if request.steps:
        _check_steps(simulation, "StepModel", request.steps)
    world = simulation.world
    model = world.model(request.model_name)
    report = _set_model(world, model, request)

    def respond(success, outcome):
        message = "" if success else f"StepModel: {outcome}"
        message = simulation.message(message, *remarks(model, report))
        response = _model_state(world, model, success, message)
        response.clamped = [*report.clamped]
        return response

    if not request.steps:
        return respond(True, "0 steps done")
    return simulation.stepper.request(request.steps, respond)


def _check_steps(simulation: Simulation, service: str, steps: int) -> None:
    """Check that steps can be requested.

    Raises:
        RefusalError: If time is running, or a step has no length.
    """
    if not simulation.stepper.paused:
        why = "time is running; call pause_physics first"
        raise RefusalError(f"{service}: refused, {why}")
    if steps and not simulation.world.properties.step_ns:
        raise RefusalError(f"{service}: refused, time_step is 0")


def _set_model(world: World, model: Model, request) -> Report:
    """Set a model's base and joints; nothing is changed on an error.

    Raises:
        UnknownNameError: If it has no such joint.
        InvalidValueError: If a number is invalid.
    """
    names, positions = request.joint_names, request.joint_positions
    if len(names) != len(positions):
        raise InvalidValueError(
            "joint_names and joint_positions must have the same length (got "
            f"{len(names)} and {len(positions)})"
        )
    unknown = [name for name in names if name not in model.joint_names]
    if unknown:
        near = listed(similar_first(unknown[0], model.joint_names))
        raise UnknownNameError(
            f"{model.name} has no movable joint {listed(unknown)}, it has "
            f"{near or 'none'}"
        )
    checked("joint_positions", positions)
    pose = checked_pose(request.base_pose) if request.set_base else None
    report = world.set_joint_positions(model.name, dict(zip(names, positions)))
    if pose is not None:  # last: with an anchor, joints move the base
        world.set_root_state(model, pose, model.twist * 0.0)
    return report


def _model_state(world: World, model: Model, success: bool, message: str):
    """Return a model's state; none if it was deleted."""
    if world.models.get(model.name) is not model:
        reasons = filter(None, (message, f"StepModel: {model.name} was deleted"))
        return StepModelResponse(success=False, status_message="; ".join(reasons))
    response = StepModelResponse(success=success, status_message=message)
    states = response.joint_states
    states.header.stamp = stamp_from_ns(world.time_ns)
    states.name = list(model.joint_names)
    states.position = model.position.tolist()
    states.velocity = model.velocity.tolist()
    row = model.trees[0].root_row
    response.base_pose = pose_from_array(model.poses[row])
    response.base_twist = twist_from_array(model.twists[row])
    return response


SERVICES = (
    ("get_physics_properties", GetPhysicsProperties, get_physics),
    ("set_physics_properties", SetPhysicsProperties, set_physics),
    ("set_real_time_factor", SetRealTimeFactor, set_real_time_factor),
    ("get_light_properties", GetLightProperties, get_light),
    ("set_light_properties", SetLightProperties, set_light),
    ("delete_light", DeleteLight, delete_light),
    ("pause_physics", Empty, pause),
    ("unpause_physics", Empty, unpause),
    ("reset_simulation", Empty, reset_simulation),
    ("reset_world", Empty, reset_world),
    ("step", Step, step),
    ("step_model", StepModel, step_model),
)
"""Name under the node, type, and the function that answers."""
