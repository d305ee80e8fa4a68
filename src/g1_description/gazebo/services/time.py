"""Services that pause, resume, step and reset simulated time.

All run in the simulator's loop, between two steps.
"""

from __future__ import annotations

from std_srvs.srv import Empty

from g1_description.errors import InvalidValueError, UnknownNameError
from g1_description.gazebo.services.base import (
    RefusalError,
    Simulation,
    checked,
    checked_pose,
    remarks,
)
from g1_description.ros.conversions import (
    pose_from_array,
    stamp_from_ns,
    twist_from_array,
)
from g1_description.sim.model import Model, Report
from g1_description.sim.world import World
from g1_description.srv import Step, StepModel, StepModelResponse, StepResponse
from g1_description.text import listed, similar_first


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
    report = _set(world, model, request)

    def respond(success, outcome):
        message = "" if success else f"StepModel: {outcome}"
        message = simulation.message(message, *remarks(model, report))
        response = _state(world, model, success, message)
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


def _set(world: World, model: Model, request) -> Report:
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


def _state(world: World, model: Model, success: bool, message: str):
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
    ("pause_physics", Empty, pause),
    ("unpause_physics", Empty, unpause),
    ("reset_simulation", Empty, reset_simulation),
    ("reset_world", Empty, reset_world),
    ("step", Step, step),
    ("step_model", StepModel, step_model),
)
"""Name under the node, type, and the function that answers."""
