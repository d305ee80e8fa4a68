"""gazebo_ros' services that spawn models, answered as the real Gazebo does.

A request's file is parsed in the caller's thread, while time runs on; the rest runs in
the simulator's loop, between two steps.
"""

from __future__ import annotations

import posixpath
from dataclasses import replace
from typing import NamedTuple

import rospy
from gazebo_msgs.srv import SpawnModel

from g1_description.errors import DescriptionError, G1DescriptionError
from g1_description.files.model_files import find_model
from g1_description.files.xml import check_size, parse_xml
from g1_description.gazebo.services.base import (
    FRAME_NOT_FOUND,
    RefusalError,
    Simulation,
    checked_pose,
    found,
)
from g1_description.robot.assembly import Assembly
from g1_description.robot.lumping import lump_fixed_joints
from g1_description.robot.transform import IDENTITY, compose
from g1_description.ros.parameters import parse_robot
from g1_description.sdf.world import Light, Sdf, SdfModel, read_sdf
from g1_description.sim.model import Model

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


def spawn(simulation: Simulation, parsed: ParsedRequest):
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
    ("spawn_urdf_model", SpawnModel, spawn, parse_urdf_request),
    ("spawn_sdf_model", SpawnModel, spawn, parse_sdf_request),
)
"""Name under the node, type, and the functions that answer and that parse the file."""
