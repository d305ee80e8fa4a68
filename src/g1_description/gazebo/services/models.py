"""gazebo_ros' services about models, answered as the real Gazebo does.

The file of a request to spawn is parsed in the caller's thread, while time runs on.
"""

from __future__ import annotations

import posixpath
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import replace
from typing import NamedTuple

import rospy
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
    SpawnModel,
)

from g1_description.errors import (
    DescriptionError,
    G1DescriptionError,
    InvalidValueError,
    UnknownNameError,
)
from g1_description.files.model_files import find_model
from g1_description.files.xml import check_size, parse_xml
from g1_description.gazebo.services.base import (
    FRAME_NOT_FOUND,
    RefusalError,
    Simulation,
    checked,
    checked_pose,
    found,
)
from g1_description.robot.assembly import SCOPE, Assembly
from g1_description.robot.lumping import lump_fixed_joints
from g1_description.robot.transform import IDENTITY, compose
from g1_description.ros.conversions import (
    pose_from_array,
    stamp_from_ns,
    twist_from_array,
    twist_to_array,
)
from g1_description.ros.parameters import parse_robot
from g1_description.sdf.world import Light, Sdf, SdfModel, read_sdf
from g1_description.sim.attachments import link_row
from g1_description.sim.entities import seen_from
from g1_description.sim.model import Model
from g1_description.srv import (
    AttachObject,
    DetachObject,
    GetAnchor,
    GetAnchorResponse,
    SetAnchor,
    SetAnchorResponse,
    SetGantry,
    SetGantryResponse,
)
from g1_description.text import listed


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
    pose = checked_pose(state.pose)
    twist = checked("twist", twist_to_array(state.twist))
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


def attach_object(simulation: Simulation, request):
    """Let a link carry an object. Not in Gazebo."""
    world = simulation.world
    try:
        carried, link = _object(simulation, request.object_name)
        shapes = [s for one in carried.links.values() for s in one.collisions]
        if any(shape.kind == "plane" for shape in shapes):
            raise InvalidValueError(f"{carried.name} is a plane, which no link carries")
        carrier = _carrier(simulation, request)
        world.attachments.attach(carried, link, carrier, request.link_name)
    except G1DescriptionError as error:
        raise RefusalError(str(error)) from error
    return f"{request.link_name} of {carrier.name} carries {request.object_name}"


def _carrier(simulation: Simulation, request) -> Model:
    """Find the model that carries an object; without a name, the only one that can."""
    world, link = simulation.world, request.link_name
    if request.model_name:
        return world.model(request.model_name)
    robots = [model for model in world.models.values() if model.joint_names]
    able = []
    for model in robots:
        with suppress(UnknownNameError):
            link_row(model, link)
            able.append(model)
    if len(able) == 1 or len(robots) == 1:
        return (able or robots)[0]  # whose links are listed if it lacks this one
    if not able:
        names = listed(model.name for model in robots)
        found = (
            f"none of the robots {names} has" if robots else "there is no robot with"
        )
        raise UnknownNameError(f"{found} a link {link}")
    names = listed(model.name for model in able)
    raise InvalidValueError(f"name the robot: {names} have a link {link}")


def detach_object(simulation: Simulation, request):
    """Let an object go. Not in Gazebo."""
    try:
        simulation.world.attachments.detach(*_object(simulation, request.object_name))
    except G1DescriptionError as error:
        raise RefusalError(str(error)) from error
    return f"{request.object_name} is let go"


def _object(simulation: Simulation, name: str) -> tuple[Model, str]:
    """Find the model of an object, and its link in ``model::link``."""
    world = simulation.world
    model, scope, link = name.partition(SCOPE)
    if name in world.models or not scope:
        return world.model(name), ""
    return world.model(model), link


NOT_A_MODEL = (
    "GazeboRosApiPlugin SpawnModel Failure: input model_xml not SDF or URDF, or cannot "
    "be converted to Gazebo compatible format."
)


class ParsedRequest(NamedTuple):
    """A request to spawn with its parsed file."""

    request: object
    content: SdfModel | Light | RefusalError
    """The model or light of the file, or why there is none."""

    left_out: tuple[str, ...] = ()
    """A message for each ignored part of the file."""


def spawn_model(simulation: Simulation, parsed: ParsedRequest):
    """Add a model or a light; it accepts commands when this answers."""
    request, content, left_out = parsed
    world, name = simulation.world, request.model_name
    missing = f"SpawnModel: {FRAME_NOT_FOUND}"
    frame = found(world.entities.frame, request.reference_frame, missing)
    _check(simulation, name, content)
    try:
        pose = compose(frame.pose, checked_pose(request.initial_pose))
        pose = compose(pose, content.pose)
        if isinstance(content, Light):
            world.add_light(replace(content, name=name, pose=pose))
        else:
            left_out += world.spawn(name, content.assembly, pose)
            world.models[name].robot_namespace = request.robot_namespace
            log_hulls(world.models[name])
    except G1DescriptionError as error:
        raise RefusalError(f"SpawnModel: Failure - {error}") from error
    return simulation.message("SpawnModel: Successfully spawned entity", *left_out)


def _check(simulation: Simulation, name: str, content) -> None:
    """Check that the content of a request can be spawned.

    Raises:
        RefusalError: If it cannot.
    """
    world = simulation.world
    if isinstance(content, RefusalError):
        if content.args[0] == NOT_A_MODEL:
            rospy.logerr(
                "GazeboRosApiPlugin SpawnModel Failure: input xml format not recognized"
            )
        raise content
    is_light = isinstance(content, Light)
    if name in world.models or (is_light and name in world.lights):
        rospy.logerr("SpawnModel: Failure - model name %s already exist.", name)
        raise RefusalError("SpawnModel: Failure - entity already exists.")
    if not name:
        raise RefusalError(
            "SpawnModel: Entity pushed to spawn queue, but spawn service timed out "
            "waiting for entity to appear in simulation under the name ",
            "a model needs a name",
        )


def parse_urdf_request(is_dynamic: bool, request) -> ParsedRequest:
    """Parse a URDF; in the caller's thread."""
    try:
        robot = parse_robot(request.model_xml)
        assembly: Assembly = lump_fixed_joints(robot, is_dynamic)
    except DescriptionError as error:
        return ParsedRequest(request, RefusalError(f"SpawnModel: Failure - {error}"))
    name = assembly.description.name
    return ParsedRequest(request, SdfModel(name, IDENTITY, assembly))


def parse_sdf_request(is_dynamic: bool, request) -> ParsedRequest:
    """Parse an SDF model, an SDF light or a URDF; in the caller's thread."""
    try:
        check_size("The model", len(request.model_xml))
        try:
            tag = parse_xml("model", request.model_xml).tag
        except DescriptionError as error:
            return ParsedRequest(request, RefusalError(NOT_A_MODEL, str(error)))
        if tag == "robot":
            return parse_urdf_request(is_dynamic, request)
        if tag != "sdf":
            return ParsedRequest(
                request, RefusalError(NOT_A_MODEL, f"the root element is <{tag}>")
            )
        sdf = read_sdf(request.model_xml, find_model)
        return ParsedRequest(request, _only_content(sdf), sdf.left_out)
    except DescriptionError as error:
        return ParsedRequest(request, RefusalError(f"SpawnModel: Failure - {error}"))


def _only_content(sdf: Sdf) -> SdfModel | Light:
    """Return the only model or light of a file.

    Raises:
        DescriptionError: If there is none or more than one.
    """
    things = (*sdf.models, *sdf.lights)
    if len(things) == 1:
        return things[0]
    left_out = f" ({'; '.join(sdf.left_out)})" if sdf.left_out else ""
    if not things:
        why = " ".join(sdf.refused)
        raise DescriptionError(why or f"The file has no model and no light{left_out}.")
    raise DescriptionError(
        f"The file must have one model or light (got {len(sdf.models)} models and "
        f"{len(sdf.lights)} lights){left_out}."
    )


def log_hulls(model: Model) -> None:
    """Log the deviations of simplified hulls from the meshes of a loaded model."""
    found = model.hull_deviations
    if not found:
        return
    for name, deviation in found.items():
        rospy.logdebug("%s: %s: %.2f mm", model.name, name, 1000.0 * deviation)
    worst = max(found, key=found.__getitem__)
    rospy.loginfo(
        "%s: simplified the hulls of %d meshes; largest deviation %.2f mm (%s).",
        model.name,
        len(found),
        1000.0 * found[worst],
        posixpath.basename(worst),
    )


SERVICES = (
    ("spawn_urdf_model", SpawnModel, spawn_model, parse_urdf_request),
    ("spawn_sdf_model", SpawnModel, spawn_model, parse_sdf_request),
    ("delete_model", DeleteModel, delete_model),
    ("get_model_properties", GetModelProperties, get_properties),
    ("get_world_properties", GetWorldProperties, get_world_properties),
    ("get_model_state", GetModelState, get_state),
    ("set_model_state", SetModelState, set_state),
    ("get_anchor", GetAnchor, get_anchor),
    ("set_anchor", SetAnchor, set_anchor),
    ("set_gantry", SetGantry, set_gantry),
    ("attach_object", AttachObject, attach_object),
    ("detach_object", DetachObject, detach_object),
)
"""Name under the node, type, and the functions that answer and that parse the file."""
