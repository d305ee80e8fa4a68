"""gazebo_ros' services about models, answered as the real Gazebo does.

What changes the world runs in the simulator's loop, between two steps; what reads it
(get_*) runs beside the loop, while nothing changes.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable

import rospy
from gazebo_msgs.msg import ModelState
from gazebo_msgs.srv import (
    DeleteModel,
    DeleteModelResponse,
    GetModelProperties,
    GetModelPropertiesResponse,
    GetModelState,
    GetModelStateResponse,
    GetWorldProperties,
    GetWorldPropertiesResponse,
    SetModelState,
    SetModelStateResponse,
)

from g1_description.errors import InvalidValueError, UnknownNameError
from g1_description.gazebo.services.base import (
    Services,
    StatusMessages,
    checked_pose,
    checked_twist,
)
from g1_description.robot.assembly import SCOPE, Assembly
from g1_description.ros.conversions import (
    pose_from_array,
    stamp_from_ns,
    twist_from_array,
)
from g1_description.sim.entities import ModelEntity, seen_from
from g1_description.sim.world import World


class _ModelStateResponse(GetModelStateResponse):
    """A response that keeps its header; rospy would put the connection's count in."""

    _has_header = False


class ModelServices(Services):
    """Delete, read and move models."""

    def __init__(self, world: World, messages: StatusMessages) -> None:
        """Serve a world.

        Args:
            world: What the services act on.
            messages: Composes their status messages.
        """
        super().__init__(world, messages)
        self._state_calls: Counter = Counter()

    def table(self):
        """List the services: name under the node, type, and what answers."""
        return (
            ("delete_model", DeleteModel, self.delete_model),
            ("get_model_properties", GetModelProperties, self.get_properties),
            ("get_world_properties", GetWorldProperties, self.get_world_properties),
            ("get_model_state", GetModelState, self.get_state),
            ("set_model_state", SetModelState, self.set_state),
        )

    def delete_model(self, request):
        """Remove a model; it is gone when this answers."""
        try:
            self._world.delete(request.model_name)
        except UnknownNameError:
            rospy.logerr("DeleteModel: model [%s] does not exist", request.model_name)
            return DeleteModelResponse(False, "DeleteModel: model does not exist")
        return DeleteModelResponse(True, "DeleteModel: successfully deleted model")

    def get_properties(self, request):
        """List a model's links, joints, shapes and nested models."""
        response = GetModelPropertiesResponse()
        try:
            found = self._world.entities.model(request.model_name)
        except UnknownNameError:
            name = request.model_name
            rospy.logerr("GetModelProperties: model [%s] does not exist", name)
            response.status_message = "GetModelProperties: model does not exist"
            return response
        model, assembly = found.model, found.model.assembly
        nested = found.scoped[len(model.name + SCOPE) :]
        response.body_names = _held_by(nested, model.link_names, assembly)
        response.geom_names = [
            shape.name
            for link in assembly.description.links
            for shape in link.collisions
            if assembly.holder(link.name) == nested
        ]
        joints = [j.name for j in assembly.description.joints if j.listed]
        response.joint_names = _held_by(nested, joints, assembly)
        response.child_model_names = _held_by(nested, assembly.nested, assembly)
        if nested:
            outer = assembly.holder(nested)
            response.parent_model_name = outer.rpartition(SCOPE)[-1] or model.name
        response.is_static = assembly.static
        response.success = True
        response.status_message = "GetModelProperties: got properties"
        return response

    def get_world_properties(self, _):
        """Return the time and the models."""
        return GetWorldPropertiesResponse(
            sim_time=self._world.time_ns * 1e-9,
            model_names=list(self._world.models),
            rendering_enabled=True,
            success=True,
            status_message="GetWorldProperties: got properties",
        )

    def get_state(self, request):
        """Return a model's pose and twist in a frame."""
        name, frame = request.model_name, request.relative_entity_name
        response = _ModelStateResponse()
        if name not in self._world.models:
            rospy.logerr("GetModelState: model [%s] does not exist", name)
            response.status_message = "GetModelState: model does not exist"
            return response
        self._state_calls[name] += 1
        response.header.seq = self._state_calls[name]
        response.header.stamp = stamp_from_ns(self._world.time_ns)
        response.header.frame_id = frame
        try:
            seen = self._world.entities.frame(frame)
        except UnknownNameError:
            response.status_message = (
                "GetModelState: reference relative_entity_name not found, did you "
                "forget to scope the body by model name?"
            )
            return response
        entity = ModelEntity(self._world.models[name])
        pose, twist = seen_from(seen, entity)
        response.pose, response.twist = pose_from_array(pose), twist_from_array(twist)
        response.success = True
        response.status_message = "GetModelState: got properties"
        return response

    def set_state(self, request):
        """Put a model somewhere."""
        try:
            return SetModelStateResponse(*self.apply_state(request.model_state))
        except InvalidValueError as error:
            return SetModelStateResponse(False, f"SetModelState: refused, {error}")

    def apply_state(self, state: ModelState) -> tuple[bool, str]:
        """Put a model somewhere.

        Returns:
            Success and status message.

        Raises:
            InvalidValueError: If a number is NaN, infinite or too large.
        """
        name, frame = state.model_name, state.reference_frame
        if name not in self._world.models:
            rospy.logerr("Updating ModelState: model [%s] does not exist", name)
            return False, "SetModelState: model does not exist"
        try:
            seen = self._world.entities.frame(frame)
        except UnknownNameError:
            rospy.logerr(
                "Updating ModelState: for model[%s], specified reference frame entity "
                "[%s] does not exist",
                name,
                frame,
            )
            message = "SetModelState: specified reference frame entity does not exist"
            return False, message
        pose, twist = checked_pose(state.pose), checked_twist(state.twist)
        self._world.set_model_state(self._world.models[name], pose, twist, seen)
        detail = self._no_effect("the twist is ignored") if twist.any() else ""
        message = "SetModelState: set model state done"
        return True, self._messages.compose(message, [detail])


def _held_by(model: str, names: Iterable[str], assembly: Assembly) -> list[str]:
    """Return names relative to the model that holds them directly.

    Args:
        model: One of the assembly's nested models; empty for the outermost.
        names: Of links, joints or nested models, as the assembly has them.
        assembly: What the model is part of.
    """
    begin = len(model + SCOPE) if model else 0
    return [name[begin:] for name in names if assembly.holder(name) == model]
