"""gazebo_ros' services about models, answered as the real Gazebo does.

Services that change the world run in the simulator's loop, between two steps; the
others (get_*) run outside of the loop, while nothing changes.
"""

from __future__ import annotations

from collections.abc import Iterable

from gazebo_msgs.msg import ModelState
from gazebo_msgs.srv import (
    DeleteModel,
    GetModelProperties,
    GetModelPropertiesResponse,
    GetModelState,
    GetModelStateResponse,
    GetWorldProperties,
    GetWorldPropertiesResponse,
    SetModelState,
)

from g1_description.errors import G1DescriptionError, UnknownNameError
from g1_description.gazebo.services.base import (
    RefusalError,
    Simulation,
    checked,
    checked_pose,
    checked_twist,
    found,
)
from g1_description.robot.assembly import SCOPE, Assembly
from g1_description.ros.conversions import (
    pose_from_array,
    stamp_from_ns,
    twist_from_array,
)
from g1_description.sim.entities import seen_from
from g1_description.srv import (
    GetAnchor,
    GetAnchorResponse,
    SetAnchor,
    SetAnchorResponse,
    SetGantry,
    SetGantryResponse,
)


class _ModelStateResponse(GetModelStateResponse):
    """A response that keeps its header; rospy would set ``seq``."""

    _has_header = False


def delete_model(simulation: Simulation, request):
    """Delete a model."""
    name, world = request.model_name, simulation.world
    lost = "DeleteModel: model does not exist"
    found(world.model, name, lost, f"DeleteModel: model [{name}] does not exist")
    world.delete(name)
    return "DeleteModel: successfully deleted model"


def get_properties(simulation: Simulation, request):
    """List a model's links, joints, shapes and nested models."""
    entity = found(
        simulation.world.entities.model,
        request.model_name,
        "GetModelProperties: model does not exist",
        f"GetModelProperties: model [{request.model_name}] does not exist",
    )
    model, assembly = entity.model, entity.model.assembly
    joints = (j.name for j in assembly.description.joints if j.listed)
    nested = entity.scoped[len(model.name + SCOPE) :]
    outer = assembly.holder(nested).rpartition(SCOPE)[-1] or model.name
    return GetModelPropertiesResponse(
        parent_model_name=outer if nested else "",
        body_names=_names_in(nested, model.link_names, assembly),
        geom_names=[
            shape.name
            for link in assembly.description.links
            for shape in link.collisions
            if assembly.holder(link.name) == nested
        ],
        joint_names=_names_in(nested, joints, assembly),
        child_model_names=_names_in(nested, assembly.nested, assembly),
        is_static=assembly.static,
        success=True,
        status_message="GetModelProperties: got properties",
    )


def _names_in(model: str, names: Iterable[str], assembly: Assembly) -> list[str]:
    """Return names directly in a nested model, relative to it; '': the outermost."""
    begin = len(model + SCOPE) if model else 0
    return [name[begin:] for name in names if assembly.holder(name) == model]


def get_world_properties(simulation: Simulation, _):
    """Return the time and the models."""
    return GetWorldPropertiesResponse(
        sim_time=simulation.world.time_ns * 1e-9,
        model_names=list(simulation.world.models),
        rendering_enabled=True,
        success=True,
        status_message="GetWorldProperties: got properties",
    )


def get_state(simulation: Simulation, request):
    """Return a model's pose and twist in a frame."""
    world, name = simulation.world, request.model_name
    lost = "GetModelState: model does not exist"
    log = f"GetModelState: model [{name}] does not exist"
    model = found(world.model, name, lost, log)
    simulation.state_calls[name] += 1
    response = _ModelStateResponse()
    response.header.seq = simulation.state_calls[name]
    response.header.stamp = stamp_from_ns(world.time_ns)
    response.header.frame_id = request.relative_entity_name
    try:
        frame = world.entities.frame(request.relative_entity_name)
    except UnknownNameError:
        response.status_message = (
            "GetModelState: reference relative_entity_name not found, did you "
            "forget to scope the body by model name?"
        )
        return response
    pose, twist = seen_from(frame, model)
    response.pose, response.twist = pose_from_array(pose), twist_from_array(twist)
    response.success = True
    response.status_message = "GetModelState: got properties"
    return response


def set_state(simulation: Simulation, request):
    """Set a model's pose and twist."""
    return put_model(simulation, request.model_state)


def put_model(simulation: Simulation, state: ModelState) -> str:
    """Set a model's pose and twist; return the status message.

    Raises:
        RefusalError: If there is no such model or frame.
        InvalidValueError: If a number is NaN, infinite or too large.
    """
    world, name, frame = simulation.world, state.model_name, state.reference_frame
    model = found(
        world.model,
        name,
        "SetModelState: model does not exist",
        f"Updating ModelState: model [{name}] does not exist",
    )
    seen = found(
        world.entities.frame,
        frame,
        "SetModelState: specified reference frame entity does not exist",
        f"Updating ModelState: for model[{name}], specified reference frame entity "
        f"[{frame}] does not exist",
    )
    pose, twist = checked_pose(state.pose), checked_twist(state.twist)
    world.set_model_state(model, pose, twist, seen)
    detail = simulation.no_effect("the twist is ignored") if twist.any() else ""
    return simulation.message("SetModelState: set model state done", detail)


def get_anchor(simulation: Simulation, request):
    """Return a model's anchor. Not in Gazebo."""
    world = simulation.world
    anchor = world.anchors.name(world.model(request.model_name))
    return GetAnchorResponse(success=True, link_name=anchor)


def set_anchor(simulation: Simulation, request):
    """Keep a link of a model at its place while joints move. Not in Gazebo."""
    world = simulation.world
    try:
        model = world.model(request.model_name)
        previous = world.anchors.name(model)
        world.anchors.set(model, request.link_name)
    except G1DescriptionError as error:
        raise RefusalError(str(error)) from error
    return SetAnchorResponse(success=True, previous=previous)


def set_gantry(simulation: Simulation, request):
    """Hang a model on a rope, or let it go. Not in Gazebo."""
    gantries, length = simulation.world.gantries, 0.0
    try:
        model = simulation.world.model(request.model_name)
        if request.enable:
            (length,) = checked("length", [request.length])
            length = gantries.hang(model, request.link_name, float(length))
        else:
            gantries.forget(model)
    except G1DescriptionError as error:
        raise RefusalError(str(error)) from error
    return SetGantryResponse(success=True, length=length)


SERVICES = (
    ("delete_model", DeleteModel, delete_model),
    ("get_model_properties", GetModelProperties, get_properties),
    ("get_world_properties", GetWorldProperties, get_world_properties),
    ("get_model_state", GetModelState, get_state),
    ("set_model_state", SetModelState, set_state),
    ("get_anchor", GetAnchor, get_anchor),
    ("set_anchor", SetAnchor, set_anchor),
    ("set_gantry", SetGantry, set_gantry),
)
"""Name under the node, type, and the function that answers."""
