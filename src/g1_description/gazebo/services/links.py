"""gazebo_ros' services about links, answered as the real Gazebo does.

What changes the world runs in the simulator's loop, between two steps; what reads it
(get_*) runs beside the loop, while nothing changes.
"""

from __future__ import annotations

import numpy as np
import rospy
from gazebo_msgs.msg import LinkState
from gazebo_msgs.srv import (
    ApplyBodyWrench,
    ApplyBodyWrenchResponse,
    BodyRequest,
    BodyRequestResponse,
    GetLinkProperties,
    GetLinkPropertiesResponse,
    GetLinkState,
    GetLinkStateResponse,
    SetLinkProperties,
    SetLinkPropertiesResponse,
    SetLinkState,
    SetLinkStateResponse,
)

from g1_description.errors import DescriptionError, InvalidValueError, UnknownNameError
from g1_description.gazebo.services.base import (
    FRAME_NOT_FOUND,
    LINK_NOT_FOUND,
    Services,
    StatusMessages,
    checked,
    checked_pose,
    checked_twist,
    time_span,
)
from g1_description.robot.description import Inertial
from g1_description.robot.rotation import rotate
from g1_description.robot.transform import IDENTITY, compose, inverse
from g1_description.ros.conversions import (
    pose_from_array,
    twist_from_array,
    vector_to_array,
    wrench_to_array,
)
from g1_description.ros.log import SHORT_PERIOD, ThrottledLog
from g1_description.sim.entities import WORLD_ENTITY, Frame, LinkEntity, seen_from
from g1_description.sim.world import World

POSE_TOLERANCE = 1e-4
"""A link this close to the requested pose has reached it, in [m] and [rad]."""

MIN_MASS = 1e-9
"""Smallest mass that a link can be given, in [kg]."""


class LinkServices(Services):
    """Read links, move them, apply wrenches, change their mass."""

    def __init__(
        self, world: World, messages: StatusMessages, log: ThrottledLog
    ) -> None:
        """Serve a world.

        Args:
            world: What the services act on.
            messages: Composes their status messages.
            log: Where to log poses that a link cannot reach.
        """
        super().__init__(world, messages)
        self._log = log

    def table(self):
        """List the services: name under the node, type, and what answers."""
        return (
            ("get_link_state", GetLinkState, self.get_state),
            ("set_link_state", SetLinkState, self.set_state),
            ("get_link_properties", GetLinkProperties, self.get_properties),
            ("set_link_properties", SetLinkProperties, self.set_properties),
            ("apply_body_wrench", ApplyBodyWrench, self.apply_wrench),
            ("clear_body_wrenches", BodyRequest, self.clear_wrenches),
        )

    def get_state(self, request):
        """Return a link's pose and twist in a frame."""
        response = GetLinkStateResponse()
        try:
            link = self._world.entities.link(request.link_name)
        except UnknownNameError:
            response.status_message = f"GetLinkState: {LINK_NOT_FOUND}"
            return response
        try:
            frame = self._world.entities.frame(request.reference_frame)
        except UnknownNameError:
            response.status_message = f"GetLinkState: {FRAME_NOT_FOUND}"
            return response
        pose, twist = seen_from(frame, link)
        response.link_state = LinkState(
            link_name=request.link_name,
            pose=pose_from_array(pose),
            twist=twist_from_array(twist),
            reference_frame=request.reference_frame,
        )
        response.success = True
        response.status_message = "GetLinkState: got state"
        return response

    def set_state(self, request):
        """Put a link somewhere."""
        try:
            return SetLinkStateResponse(*self.apply_state(request.link_state))
        except InvalidValueError as error:
            return SetLinkStateResponse(False, f"SetLinkState: refused, {error}")

    def apply_state(self, state: LinkState) -> tuple[bool, str]:
        """Put a link somewhere: a root with its model, others along their joint.

        The twist is for the center of mass, along the world's axes whatever the
        frame is, and the frame's own twist is subtracted: so does Gazebo.

        Returns:
            Success and status message.

        Raises:
            InvalidValueError: If the link is fixed to another one, or a number is
                NaN, infinite or too large.
        """
        try:
            link = self._found_link(state.link_name)
            frame = self._link_frame(state.reference_frame)
        except UnknownNameError as error:
            return False, f"SetLinkState: {error}"
        pose, twist = checked_pose(state.pose), checked_twist(state.twist)
        if frame is WORLD_ENTITY:
            rospy.loginfo(
                "Updating LinkState: reference_frame is empty/world/map, "
                "using inertial frame"
            )
        target = compose(frame.pose, pose)
        placed = self._world.set_link_state(link, target, twist - frame.twist)
        details = [self._no_effect("the twist is ignored") if twist.any() else ""]
        if placed and max(placed.distance, placed.angle) > POSE_TOLERANCE:
            details.append(
                f"{placed.joint} brings {link.scoped} no nearer than "
                f"{round(placed.distance, 4):g} m and {round(placed.angle, 4):g} rad "
                "to that pose"
            )
            self._log.warn(
                "set_link_state", f"SetLinkState: {details[-1]}", SHORT_PERIOD
            )
        return True, self._messages.compose("SetLinkState: success", details)

    def _link_frame(self, name: str) -> Frame:
        """Find a frame for set_link_state; a refusal is in Gazebo's message."""
        try:
            return self._world.entities.link_frame(name)
        except UnknownNameError:
            rospy.logerr(
                "Updating LinkState: reference_frame is not a valid entity name"
            )
            raise UnknownNameError("failed") from None

    def _found_link(self, name: str) -> LinkEntity:
        """Find a link for set_link_state; a refusal is in Gazebo's message."""
        try:
            return self._world.entities.link(name)
        except UnknownNameError:
            rospy.logerr("Updating LinkState: link [%s] does not exist", name)
            raise UnknownNameError("link does not exist") from None

    def get_properties(self, request):
        """Return a link's mass; static links have none."""
        response = GetLinkPropertiesResponse()
        try:
            entity = self._world.entities.link(request.link_name)
        except UnknownNameError:
            response.status_message = f"GetLinkProperties: {LINK_NOT_FOUND}"
            return response
        response.com = pose_from_array(IDENTITY)
        link, detail = entity.link, ""
        if not entity.model.assembly.static:
            response.gravity_mode = link.has_gravity
            if link.inertial is None:
                detail = "its mass is not known"
            else:
                _tell_inertial(response, link.inertial)
        response.success = True
        message = "GetLinkProperties: got properties"
        response.status_message = self._messages.compose(message, [detail])
        return response

    def set_properties(self, request):
        """Give a link another mass."""
        try:
            entity = self._world.entities.link(request.link_name)
        except UnknownNameError:
            message = f"SetLinkProperties: {LINK_NOT_FOUND}"
            return SetLinkPropertiesResponse(False, message)
        message, detail = "SetLinkProperties: properties set", ""
        try:
            inertial = _inertial(request)
            if entity.model.assembly.static:
                detail = f"ignored, {entity.model.name} is static"
            else:
                self._world.set_link_properties(entity, inertial, request.gravity_mode)
        except (InvalidValueError, DescriptionError) as error:
            return SetLinkPropertiesResponse(
                False, f"SetLinkProperties: refused, {error}"
            )
        message = self._messages.compose(message, [detail])
        return SetLinkPropertiesResponse(True, message)

    def apply_wrench(self, request):
        """Push a link for a while."""
        entities = self._world.entities
        try:
            link = entities.link(request.body_name)
        except UnknownNameError:
            rospy.logerr("ApplyBodyWrench: body [%s] does not exist", request.body_name)
            return ApplyBodyWrenchResponse(
                False, "ApplyBodyWrench: body does not exist"
            )
        try:
            frame = entities.frame(request.reference_frame)
        except UnknownNameError:
            rospy.logerr("ApplyBodyWrench: reference_frame is not a valid entity name")
            return ApplyBodyWrenchResponse(
                False, "ApplyBodyWrench: reference_frame not found"
            )
        try:
            wrench = checked("wrench", wrench_to_array(request.wrench))
            point = checked("reference point", vector_to_array(request.reference_point))
        except InvalidValueError as error:
            return ApplyBodyWrenchResponse(False, f"ApplyBodyWrench: refused, {error}")
        force, torque = wrench.reshape(2, 3)
        torque = torque + np.cross(point, force)
        if frame is WORLD_ENTITY:
            rospy.loginfo(
                "ApplyBodyWrench: reference_frame is empty/world/map, using inertial "
                "frame, transferring from body relative to inertial frame"
            )
        else:
            T_link_frame = compose(inverse(link.pose), frame.pose)
            force, torque = rotate(T_link_frame[3:], np.array([force, torque]))
            torque = torque + np.cross(T_link_frame[:3], force)
        span = time_span(request.start_time, request.duration, self._world.time_ns)
        applied = np.concatenate([force, torque])
        self._world.forces.apply_wrench(link, span, applied, self._world.time_ns)
        message = self._messages.compose("", [self._no_effect("nothing moves")])
        return ApplyBodyWrenchResponse(True, message)

    def clear_wrenches(self, request):
        """Stop pushing a link; only its scoped name is known here."""
        self._world.forces.clear_wrenches(request.body_name)
        return BodyRequestResponse()


def _tell_inertial(response, inertial: Inertial) -> None:
    """Write mass properties into a response."""
    center = response.com.position
    response.mass = inertial.mass
    center.x, center.y, center.z = inertial.center_of_mass.tolist()
    response.ixx, response.ixy, response.ixz = inertial.inertia[0].tolist()
    response.iyy, response.iyz = inertial.inertia[1, 1:].tolist()
    response.izz = float(inertial.inertia[2, 2])


def _inertial(request) -> Inertial:
    """Read mass properties; the orientation of the center of mass means nothing.

    Raises:
        InvalidValueError: If no body can have them.
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
            f"mass {mass} and inertia {tensor.tolist()} are not those of a body, both "
            f"must be positive and the mass at least {MIN_MASS:g}"
        )
    return Inertial(float(mass), center, tensor)
