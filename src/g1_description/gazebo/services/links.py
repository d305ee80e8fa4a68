"""gazebo_ros' services about links, answered as the real Gazebo does."""

from __future__ import annotations

import numpy as np
import rospy
from gazebo_msgs.msg import LinkState
from gazebo_msgs.srv import (
    ApplyBodyWrench,
    BodyRequest,
    GetLinkProperties,
    GetLinkPropertiesResponse,
    GetLinkState,
    GetLinkStateResponse,
    SetLinkProperties,
    SetLinkState,
)

from g1_description.errors import InvalidValueError
from g1_description.gazebo.services.base import (
    FRAME_NOT_FOUND,
    LINK_NOT_FOUND,
    Simulation,
    checked,
    checked_pose,
    found,
    time_span,
)
from g1_description.robot.description import Inertial
from g1_description.robot.rotation import rotate
from g1_description.robot.transform import IDENTITY, compose, inverse
from g1_description.ros.conversions import (
    pose_from_array,
    twist_from_array,
    twist_to_array,
    vector_to_array,
)
from g1_description.ros.log import SHORT_PERIOD
from g1_description.sim.entities import WORLD_FRAME, seen_from

POSE_TOLERANCE = 1e-4
"""A link this close to the requested pose has reached it, in [m] and [rad]."""

MIN_MASS = 1e-9
"""Smallest mass that a link can be given, in [kg]."""


def get_state(simulation: Simulation, request):
    """Return a link's pose and twist in a frame."""
    name, relative = request.link_name, request.reference_frame
    entities = simulation.world.entities
    link = found(entities.link, name, f"GetLinkState: {LINK_NOT_FOUND}")
    frame = found(entities.frame, relative, f"GetLinkState: {FRAME_NOT_FOUND}")
    pose, twist = seen_from(frame, link)
    return GetLinkStateResponse(
        link_state=LinkState(
            link_name=name,
            pose=pose_from_array(pose),
            twist=twist_from_array(twist),
            reference_frame=relative,
        ),
        success=True,
        status_message="GetLinkState: got state",
    )


def set_state(simulation: Simulation, request):
    """Set a link's pose and twist."""
    return put_link(simulation, request.link_state)


def put_link(simulation: Simulation, state: LinkState) -> str:
    """Set the pose of a link: a root with its model, others along their joint.

    As in Gazebo, the twist is that of the center of mass, always along the world's
    axes, and the frame's own twist is subtracted.

    Returns:
        The status message.

    Raises:
        RefusalError: If there is no such link or frame.
        InvalidValueError: If the link is fixed to another one, or a number is
            NaN, infinite or too large.
    """
    world, name = simulation.world, state.link_name
    link = found(
        world.entities.link,
        name,
        "SetLinkState: link does not exist",
        f"Updating LinkState: link [{name}] does not exist",
    )
    frame = found(
        lambda name: world.entities.frame(name, ("link",)),
        state.reference_frame,
        "SetLinkState: failed",
        "Updating LinkState: reference_frame is not a valid entity name",
    )
    pose = checked_pose(state.pose)
    twist = checked("twist", twist_to_array(state.twist))
    if frame is WORLD_FRAME:
        rospy.loginfo(
            "Updating LinkState: reference_frame is empty/world/map, "
            "using inertial frame"
        )
    target = compose(frame.pose, pose)
    placed = world.set_link_state(link, target, twist - frame.twist)
    details = [simulation.no_effect("the twist is ignored") if twist.any() else ""]
    if placed and max(placed.distance, placed.angle) > POSE_TOLERANCE:
        details.append(
            f"with {placed.joint}, {link.scoped} is still "
            f"{round(placed.distance, 4):g} m and {round(placed.angle, 4):g} rad "
            "from that pose"
        )
        warning = f"SetLinkState: {details[-1]}"
        simulation.log.warn("set_link_state", warning, SHORT_PERIOD)
    return simulation.message("SetLinkState: success", *details)


def get_properties(simulation: Simulation, request):
    """Return a link's mass; static links have none."""
    missing = f"GetLinkProperties: {LINK_NOT_FOUND}"
    entity = found(simulation.world.entities.link, request.link_name, missing)
    response = GetLinkPropertiesResponse(com=pose_from_array(IDENTITY), success=True)
    link, detail = entity.link, ""
    if not entity.model.assembly.static:
        response.gravity_mode = link.has_gravity
        if link.inertial is None:
            detail = "its mass is unknown"
        else:
            inertial, center = link.inertial, response.com.position
            response.mass = inertial.mass
            center.x, center.y, center.z = inertial.center_of_mass.tolist()
            response.ixx, response.ixy, response.ixz = inertial.inertia[0].tolist()
            response.iyy, response.iyz = inertial.inertia[1, 1:].tolist()
            response.izz = float(inertial.inertia[2, 2])
    message = "GetLinkProperties: got properties"
    response.status_message = simulation.message(message, detail)
    return response


def set_properties(simulation: Simulation, request):
    """Set a link's mass properties."""
    world, missing = simulation.world, f"SetLinkProperties: {LINK_NOT_FOUND}"
    link = found(world.entities.link, request.link_name, missing)
    inertial, detail = _inertial(request), ""
    if link.model.assembly.static:
        detail = f"ignored, {link.model.name} is static"
    else:
        world.set_link_properties(link, inertial, request.gravity_mode)
    return simulation.message("SetLinkProperties: properties set", detail)


def _inertial(request) -> Inertial:
    """Read mass properties; the orientation of the center of mass is ignored.

    Raises:
        InvalidValueError: If they are not physical.
    """
    center = checked("center of mass", vector_to_array(request.com.position))
    (mass,) = checked("mass", [request.mass])
    r = request
    tensor = checked(
        "inertia",
        [[r.ixx, r.ixy, r.ixz], [r.ixy, r.iyy, r.iyz], [r.ixz, r.iyz, r.izz]],
    )
    if mass < MIN_MASS or np.linalg.eigvalsh(tensor)[0] <= 0.0:
        raise InvalidValueError(
            f"the mass must be at least {MIN_MASS:g} and the inertia positive definite "
            f"(got {mass} and {tensor.tolist()})"
        )
    return Inertial(float(mass), center, tensor)


def apply_wrench(simulation: Simulation, request):
    """Apply a wrench to a link for a duration."""
    world, name = simulation.world, request.body_name
    link = found(
        world.entities.link,
        name,
        "ApplyBodyWrench: body does not exist",
        f"ApplyBodyWrench: body [{name}] does not exist",
    )
    frame = found(
        world.entities.frame,
        request.reference_frame,
        "ApplyBodyWrench: reference_frame not found",
        "ApplyBodyWrench: reference_frame is not a valid entity name",
    )
    parts = map(vector_to_array, (request.wrench.force, request.wrench.torque))
    wrench = checked("wrench", np.concatenate([*parts]))
    point = checked("reference point", vector_to_array(request.reference_point))
    force, torque = wrench.reshape(2, 3)
    torque = torque + np.cross(point, force)
    if frame is WORLD_FRAME:
        rospy.loginfo(
            "ApplyBodyWrench: reference_frame is empty/world/map, using inertial "
            "frame, transferring from body relative to inertial frame"
        )
    else:
        T_link_frame = compose(inverse(link.pose), frame.pose)
        force, torque = rotate(T_link_frame[3:], np.array([force, torque]))
        torque = torque + np.cross(T_link_frame[:3], force)
    span = time_span(request.start_time, request.duration, world.time_ns)
    applied = np.concatenate([force, torque])
    world.forces.apply_wrench(link, span, applied, world.time_ns)
    return simulation.message("", simulation.no_effect("nothing moves"))


def clear_wrenches(simulation: Simulation, request):
    """Clear the wrenches on a link by its scoped name, as in Gazebo."""
    simulation.world.forces.clear_wrenches(request.body_name)


SERVICES = (
    ("get_link_state", GetLinkState, get_state),
    ("set_link_state", SetLinkState, set_state),
    ("get_link_properties", GetLinkProperties, get_properties),
    ("set_link_properties", SetLinkProperties, set_properties),
    ("apply_body_wrench", ApplyBodyWrench, apply_wrench),
    ("clear_body_wrenches", BodyRequest, clear_wrenches),
)
"""Name under the node, type, and the function that answers."""
