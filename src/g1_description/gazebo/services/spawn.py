"""gazebo_ros' services that spawn models, answered as the real Gazebo does.

A request's file is parsed in the caller's thread, while time runs on; the rest runs in
the simulator's loop, between two steps.
"""

from __future__ import annotations

import posixpath
from dataclasses import dataclass, replace
from functools import partial

import rospy
from gazebo_msgs.srv import SpawnModel, SpawnModelResponse

from g1_description.errors import DescriptionError, G1DescriptionError, UnknownNameError
from g1_description.files.model_files import find_model
from g1_description.files.xml import check_size, parse_xml
from g1_description.gazebo.services.base import FRAME_NOT_FOUND, Services, checked_pose
from g1_description.robot.assembly import Assembly
from g1_description.robot.lumping import lump_fixed_joints
from g1_description.robot.transform import IDENTITY, compose
from g1_description.robot.urdf import parse_urdf
from g1_description.sdf.world import Light, Sdf, SdfModel, read_sdf
from g1_description.sim.entities import Frame
from g1_description.sim.model import Model

NOT_A_MODEL = (
    "GazeboRosApiPlugin SpawnModel Failure: input model_xml not SDF or URDF, or cannot "
    "be converted to Gazebo compatible format."
)


@dataclass(frozen=True)
class ParsedRequest:
    """A request to spawn whose file is parsed."""

    request: object
    content: SdfModel | Light | None = None
    refusal: tuple[str, ...] = ()
    """Gazebo's message and our details for why there is no content."""

    left_out: tuple[str, ...] = ()
    """A sentence for each thing in the file that is left out."""


class SpawnServices(Services):
    """Spawn models and lights."""

    def table(self):
        """List the services: name, type, what answers, and what parses the file."""
        dynamic = self._world.is_dynamic
        urdf, sdf = (
            partial(parse_urdf_request, dynamic),
            partial(parse_sdf_request, dynamic),
        )
        return (
            ("spawn_urdf_model", SpawnModel, self.spawn, urdf),
            ("spawn_sdf_model", SpawnModel, self.spawn, sdf),
        )

    def spawn(self, parsed: ParsedRequest):
        """Add a model or a light; it can be commanded when this answers."""
        try:
            frame = self._world.entities.frame(parsed.request.reference_frame)
        except UnknownNameError:
            return SpawnModelResponse(False, f"SpawnModel: {FRAME_NOT_FOUND}")
        refusal = self._refusal(parsed)
        if refusal:
            return SpawnModelResponse(False, refusal)
        try:
            details = self._add(parsed, frame)
        except G1DescriptionError as error:
            return SpawnModelResponse(False, f"SpawnModel: Failure - {error}")
        message = "SpawnModel: Successfully spawned entity"
        return SpawnModelResponse(True, self._messages.compose(message, details))

    def _refusal(self, parsed: ParsedRequest) -> str:
        """Say why nothing can be spawned; empty if it can."""
        name = parsed.request.model_name
        if parsed.content is None:
            message, *details = parsed.refusal
            if message == NOT_A_MODEL:
                rospy.logerr(
                    "GazeboRosApiPlugin SpawnModel Failure: input xml format not "
                    "recognized"
                )
            return self._messages.compose(message, details)
        is_light = isinstance(parsed.content, Light)
        if name in self._world.models or (is_light and name in self._world.lights):
            rospy.logerr("SpawnModel: Failure - model name %s already exist.", name)
            return "SpawnModel: Failure - entity already exists."
        if not name:
            message = (
                "SpawnModel: Entity pushed to spawn queue, but spawn service timed out "
                "waiting for entity to appear in simulation under the name "
            )
            return self._messages.compose(message, ["a model needs a name"])
        return ""

    def _add(self, parsed: ParsedRequest, frame: Frame) -> tuple[str, ...]:
        """Add the content under the requested name; return what was left out."""
        request, content = parsed.request, parsed.content
        pose = compose(frame.pose, checked_pose(request.initial_pose))
        pose = compose(pose, content.pose)
        if isinstance(content, Light):
            light = replace(content, name=request.model_name, pose=pose)
            self._world.add_light(light)
            return parsed.left_out
        left_out = self._world.spawn(request.model_name, content.assembly, pose)
        model = self._world.models[request.model_name]
        model.robot_namespace = request.robot_namespace
        log_hulls(model)
        return parsed.left_out + left_out


def parse_urdf_request(is_dynamic: bool, request) -> ParsedRequest:
    """Read a robot; in the caller's thread, time runs on meanwhile."""
    try:
        return ParsedRequest(request, _read_urdf(request.model_xml, is_dynamic))
    except DescriptionError as error:
        return ParsedRequest(request, refusal=(f"SpawnModel: Failure - {error}",))


def parse_sdf_request(is_dynamic: bool, request) -> ParsedRequest:
    """Read a model, a light or a robot; in the caller's thread."""
    try:
        check_size("The model", len(request.model_xml))
    except DescriptionError as error:
        return ParsedRequest(request, refusal=(f"SpawnModel: Failure - {error}",))
    try:
        tag = parse_xml("model", request.model_xml).tag
    except DescriptionError as error:
        return ParsedRequest(request, refusal=(NOT_A_MODEL, str(error)))
    if tag == "robot":
        return parse_urdf_request(is_dynamic, request)
    if tag != "sdf":
        return ParsedRequest(request, refusal=(NOT_A_MODEL, f"it is a <{tag}>"))
    try:
        sdf = read_sdf(request.model_xml, find_model)
        return ParsedRequest(request, _only_content(sdf), left_out=sdf.left_out)
    except DescriptionError as error:
        return ParsedRequest(request, refusal=(f"SpawnModel: Failure - {error}",))


def _read_urdf(text: str, is_dynamic: bool) -> SdfModel:
    """Read a robot as if it had come as SDF."""
    assembly: Assembly = lump_fixed_joints(parse_urdf(text), is_dynamic)
    return SdfModel(assembly.description.name, IDENTITY, assembly)


def _only_content(sdf: Sdf) -> SdfModel | Light:
    """Give the one model or light of a file.

    Raises:
        DescriptionError: If there is not one.
    """
    things = (*sdf.models, *sdf.lights)
    if len(things) == 1:
        return things[0]
    left_out = f" ({'; '.join(sdf.left_out)})" if sdf.left_out else ""
    if not things:
        why = " ".join(sdf.refused)
        raise DescriptionError(why or f"It has no model and no light{left_out}.")
    raise DescriptionError(
        f"It has {len(sdf.models)} models and {len(sdf.lights)} lights; one model or "
        f"light can be spawned at a time{left_out}."
    )


def log_hulls(model: Model) -> None:
    """Log how far meshes of a model are from their hulls, where these are thinned.

    Args:
        model: The model, which has been loaded.
    """
    found = model.hull_deviations
    if not found:
        return
    for name, deviation in found.items():
        rospy.logdebug("%s: %s: %.2f mm", model.name, name, 1000.0 * deviation)
    worst = max(found, key=found.__getitem__)
    rospy.loginfo(
        "%s: hulls of %d meshes are thinned; they are at most %.2f mm from these (%s).",
        model.name,
        len(found),
        1000.0 * found[worst],
        posixpath.basename(worst),
    )
