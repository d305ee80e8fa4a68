"""gazebo_ros' services about joints, answered as the real Gazebo does."""

from __future__ import annotations

import math

import numpy as np
from gazebo_msgs.srv import (
    ApplyJointEffort,
    GetJointProperties,
    GetJointPropertiesResponse,
    JointRequest,
    SetJointProperties,
    SetModelConfiguration,
)

from g1_description.bounds import MAX_VALUE
from g1_description.errors import G1DescriptionError, InvalidValueError, MotionError
from g1_description.gazebo.services.base import (
    RefusalError,
    Simulation,
    checked,
    found,
    remarks,
    time_span,
)
from g1_description.motion.motion import Motion
from g1_description.msg import ModelTrajectory, MotorCommands
from g1_description.robot.assembly import SCOPE
from g1_description.ros.conversions import COMMAND_FIELDS, stamp_from_ns
from g1_description.ros.log import SHORT_PERIOD
from g1_description.sim.drives import PdCommand
from g1_description.sim.model import Model
from g1_description.srv import SetModelTrajectory, SetModelTrajectoryResponse
from g1_description.text import listed

KINDS = {
    "revolute": GetJointPropertiesResponse.REVOLUTE,
    "continuous": GetJointPropertiesResponse.CONTINUOUS,
    "prismatic": GetJointPropertiesResponse.PRISMATIC,
    "fixed": GetJointPropertiesResponse.FIXED,
}


def set_configuration(simulation: Simulation, request):
    """Teleport joints."""
    world, name = simulation.world, request.model_name
    model = found(
        world.model,
        name,
        "SetModelConfiguration: model does not exist",
        f"SetModelConfiguration: model [{name}] does not exist",
    )
    if len(request.joint_names) != len(request.joint_positions):
        raise RefusalError(
            "SetModelConfiguration: joint name and position list have different lengths"
        )
    positions = _unscoped(name, request.joint_names, request.joint_positions)
    report = world.set_joint_positions(name, positions)
    return simulation.message("SetModelConfiguration: success", *remarks(model, report))


def _unscoped(model, names, positions):
    """Resolve joint names: ``joint`` wins over ``model::joint``.

    The last of equal names wins; any other name is kept.
    """
    scope = model + SCOPE
    scoped, plain = {}, {}
    for name, position in zip(names, positions):
        if name.startswith(scope):
            scoped[name[len(scope) :]] = position
        else:
            plain[name] = position
    return {**scoped, **plain}


def get_properties(simulation: Simulation, request):
    """Return a joint's type, damping, position and rate."""
    entity = _joint(simulation, request, "GetJointProperties")
    model, joint = entity.model, entity.joint
    response = GetJointPropertiesResponse(
        type=KINDS[joint.kind],
        position=[math.nan],
        rate=[0.0],
        success=True,
        status_message="GetJointProperties: got properties",
    )
    row = model.joint_row(joint.name)
    if row is not None:
        given = model.ode_joints.get(joint.name, {})
        response.damping = [given.get("damping", joint.damping)]
        response.position = [float(model.position[row])]
        response.rate = [float(model.velocity[row])]
    return response


def _joint(simulation: Simulation, request, service: str):
    """Find the joint of a request."""
    joint = simulation.world.entities.joint
    return found(joint, request.joint_name, f"{service}: joint not found")


def set_properties(simulation: Simulation, request):
    """Set a joint's ODE properties; the first of each list is used."""
    entity = _joint(simulation, request, "SetJointProperties")
    config = request.ode_joint_config
    lists = {name: getattr(config, name) for name in config.__slots__}
    numbers = {name: values[0] for name, values in lists.items() if values}
    for name, number in numbers.items():
        checked(name, [number])
    if numbers.get("damping", 0.0) < 0.0:
        raise InvalidValueError(
            f"damping must not be negative (got {numbers['damping']})"
        )
    simulation.world.set_joint_properties(entity, numbers)
    return "SetJointProperties: properties set"


def apply_effort(simulation: Simulation, request):
    """Apply an effort to a joint for a duration."""
    world = simulation.world
    entity = _joint(simulation, request, "ApplyJointEffort")
    (effort,) = checked("effort", [request.effort])
    span = time_span(request.start_time, request.duration, world.time_ns)
    world.forces.apply_effort(entity, span, float(effort))
    detail = simulation.no_effect("nothing moves")
    return simulation.message("ApplyJointEffort: effort set", detail)


def clear_efforts(simulation: Simulation, request):
    """Clear the efforts on a joint by its plain name, as in Gazebo."""
    simulation.world.forces.clear_efforts(request.joint_name)


FAR = 0.3
"""Distance to a first sample above which it is reported, in [rad] or [m]."""


def set_trajectory(simulation: Simulation, request):
    """Let a model play a motion, or stop it."""
    try:
        return _play(simulation, request.trajectory)
    except G1DescriptionError as error:
        raise RefusalError(str(error)) from error


def play(simulation: Simulation, message: ModelTrajectory) -> None:
    """Play the motion of a message on the topic, and log deviations from it.

    Raises:
        G1DescriptionError: If it is refused; nothing is changed.
    """
    details = _play(simulation, message).status_message
    if details:
        name = message.model_name
        key = f"{name} set_model_trajectory"
        simulation.log.warn(key, f"{name}: {details}", SHORT_PERIOD)


def _play(simulation: Simulation, message: ModelTrajectory):
    """Play the motion of a message, or stop joints; return the service's response."""
    world, now = simulation.world, simulation.world.time_ns
    model = world.model(message.model_name)
    response = SetModelTrajectoryResponse(success=True)
    if not message.times:
        world.motions.stop(model, message.joint_names)
        response.start = stamp_from_ns(now)
        return response
    motion = _trajectory(message)
    next_ns = now if simulation.stepper.paused else now + world.properties.step_ns
    start = message.start.to_nsec() or next_ns
    is_new = world.is_dynamic and start >= now
    jump = _jump(model, motion) if is_new else ""
    report = world.motions.play(model, motion, start)
    if start <= now:
        world.motions.step(now)
    details = [*remarks(model, report), jump]
    if motion.base_poses is not None and world.is_dynamic:
        details.append("the base is ignored, physics moves it")
    response.status_message = simulation.message("", *details)
    response.start = stamp_from_ns(start)
    response.clamped, response.ignored = [*report.clamped], report.unknown
    return response


def drive(simulation: Simulation, message: MotorCommands) -> None:
    """Let a controller drive joints; log those that are unknown.

    Raises:
        G1DescriptionError: If it is refused; nothing is changed.
    """
    world, name = simulation.world, message.model_name
    model = world.model(name)
    names = message.joint_names
    if len({*names}) < len(names):
        twice = sorted({joint for joint in names if names.count(joint) > 1})
        raise InvalidValueError(f"joint_names has {listed(twice)} more than once")
    command = np.zeros((len(COMMAND_FIELDS), len(names)))
    for row, field in enumerate(COMMAND_FIELDS):
        numbers = getattr(message, field)
        if len(numbers) not in (0, len(names)):
            raise InvalidValueError(
                f"{field} must have a number for each of the {len(names)} joints (got "
                f"{len(numbers)})"
            )
        if len(numbers):
            command[row] = numbers
    if not (np.abs(command) <= MAX_VALUE).all():
        for field, numbers in zip(COMMAND_FIELDS, command):
            checked(field, numbers)
    given = PdCommand(*command)
    for field, gains in (("kp", given.stiffness), ("kd", given.damping)):
        for row in np.flatnonzero(gains < 0.0)[:1].tolist():
            raise InvalidValueError(
                f"{field} of {names[row]} must not be negative (got {gains[row]:g})"
            )
    unknown = world.drive(model, names, given)
    if unknown:
        key = f"{name} motor_commands"
        text = f"ignored, no movable joint of {name}: {listed(unknown)}"
        simulation.log.warn(key, f"{name}: motor_commands: {text}", SHORT_PERIOD)


def _jump(model: Model, motion: Motion) -> str:
    """Describe a joint far from the first sample; empty if there is none.

    A single configuration is a command; a first sample after 0 s leaves time.
    """
    if len(motion.times) == 1 or motion.times[0] > 0.0:
        return ""
    first = dict(zip(motion.joint_names, motion.positions[0].tolist()))
    desired = np.array([first.get(n, np.nan) for n in model.joint_names])
    desired = np.minimum(np.maximum(desired, model.lower), model.upper)
    apart = np.abs(desired - model.target)
    jumps = {n: d for n, d in zip(model.joint_names, apart.tolist()) if n in first}
    name = max(jumps, key=lambda n: jumps[n], default="")
    if not name or jumps[name] <= FAR:
        return ""
    joint = model.assembly.description.movable_joints[model.joint_names.index(name)]
    distance = f"{jumps[name]:.2f} {'m' if joint.kind == 'prismatic' else 'rad'}"
    return f"joints jump to the first sample: {name} is {distance} away from it"


def _trajectory(message: ModelTrajectory) -> Motion:
    """Read a motion.

    Raises:
        MotionError: If its numbers are invalid.
    """
    n_samples, n_joints = len(message.times), len(message.joint_names)
    positions = _rows("positions", message.positions, n_samples, n_joints)
    velocities, bases = message.velocities, message.base_poses
    return Motion(
        np.array(message.times),
        tuple(message.joint_names),
        positions,
        _rows("velocities", velocities, n_samples, n_joints) if velocities else None,
        _rows("base_poses", bases, n_samples, 7) if bases else None,
    )


def _rows(label: str, numbers, n_samples: int, width: int) -> np.ndarray:
    """Arrange numbers in rows, shape (n_samples, width)."""
    if len(numbers) != n_samples * width:
        raise MotionError(
            f"{label} must have {n_samples} x {width} numbers (got {len(numbers)})"
        )
    return np.array(numbers, dtype=float).reshape(n_samples, width)


SERVICES = (
    ("set_model_configuration", SetModelConfiguration, set_configuration),
    ("get_joint_properties", GetJointProperties, get_properties),
    ("set_joint_properties", SetJointProperties, set_properties),
    ("apply_joint_effort", ApplyJointEffort, apply_effort),
    ("clear_joint_forces", JointRequest, clear_efforts),
    ("set_model_trajectory", SetModelTrajectory, set_trajectory),
)
"""Name under the node, type, and the function that answers."""
