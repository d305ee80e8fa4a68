"""gazebo_ros' services, as the real Gazebo answers them, on our world.

Everything here runs in the simulator's loop, between two steps. Status messages
start with Gazebo's own words; where Gazebo would say success and silently ignore
or change something, ours go on after "; " (unless they are to be strict).
"""

from __future__ import annotations

from collections import Counter

import numpy as np
import rospy
from gazebo_msgs.msg import ModelState
from gazebo_msgs.srv import (
    DeleteModel,
    DeleteModelResponse,
    GetModelState,
    GetModelStateResponse,
    GetWorldProperties,
    GetWorldPropertiesResponse,
    SetModelConfiguration,
    SetModelConfigurationResponse,
    SetModelState,
    SetModelStateResponse,
    SpawnModel,
    SpawnModelResponse,
)
from std_srvs.srv import Empty, EmptyResponse

from ..core.errors import (
    LARGEST,
    G1DescriptionError,
    InvalidValueError,
    UnknownNameError,
)
from ..core.rotation import normalized
from ..core.transform import compose
from ..sim.frames import find_frame
from ..sim.model import SCOPE, Report
from ..sim.world import World
from .messages import (
    pose_from_array,
    pose_to_array,
    stamp_from_ns,
    twist_from_array,
    twist_to_array,
)


class _ModelStateResponse(GetModelStateResponse):
    """A response that keeps its header; rospy would put the connection's count in."""

    _has_header = False


class GazeboServices:
    """The services, and the answers they give."""

    def __init__(self, world: World, strict_messages: bool = False) -> None:
        """Serve a world.

        Args:
            world: What the services act on.
            strict_messages: Whether to give Gazebo's bare words.
        """
        self._world = world
        self._strict = strict_messages
        self._model_state_calls: Counter = Counter()
        self.paused = False

    def table(self):
        """List the services: name under the node, type, and what answers."""
        return (
            ("set_model_configuration", SetModelConfiguration, self.set_configuration),
            ("spawn_urdf_model", SpawnModel, self.spawn_urdf_model),
            ("delete_model", DeleteModel, self.delete_model),
            ("get_world_properties", GetWorldProperties, self.get_world_properties),
            ("get_model_state", GetModelState, self.get_model_state),
            ("set_model_state", SetModelState, self.set_model_state),
            ("pause_physics", Empty, self.pause_physics),
            ("unpause_physics", Empty, self.unpause_physics),
            ("reset_simulation", Empty, self.reset_simulation),
            ("reset_world", Empty, self.reset_world),
        )

    def _say(self, words: str, clauses=()) -> str:
        """Put what we add behind Gazebo's words."""
        added = [] if self._strict else [clause for clause in clauses if clause]
        return "; ".join([words, *added])

    def set_configuration(self, request):
        """Teleport joints."""
        name = request.model_name
        if name not in self._world.models:
            rospy.logerr("SetModelConfiguration: model [%s] does not exist", name)
            return SetModelConfigurationResponse(
                False, "SetModelConfiguration: model does not exist"
            )
        if len(request.joint_names) != len(request.joint_positions):
            return SetModelConfigurationResponse(
                False,
                "SetModelConfiguration: joint name and position list have different "
                "lengths",
            )
        try:
            positions = _unscoped(name, request.joint_names, request.joint_positions)
            report = self._world.set_joint_positions(name, positions)
        except InvalidValueError as error:
            return SetModelConfigurationResponse(
                False, f"SetModelConfiguration: refused, {error}"
            )
        return SetModelConfigurationResponse(
            True, self._say("SetModelConfiguration: success", _clauses(name, report))
        )

    def spawn_urdf_model(self, request):
        """Add a robot; it can be commanded when this answers."""
        name = request.model_name
        try:
            T_world_frame, _ = find_frame(self._world.models, request.reference_frame)
        except UnknownNameError:
            return SpawnModelResponse(
                False,
                "SpawnModel: reference reference_frame not found, did you forget to "
                "scope the link by model name?",
            )
        if name in self._world.models:
            rospy.logerr("SpawnModel: Failure - model name %s already exist.", name)
            return SpawnModelResponse(
                False, "SpawnModel: Failure - entity already exists."
            )
        if not name:
            return SpawnModelResponse(
                False,
                self._say(
                    "SpawnModel: Entity pushed to spawn queue, but spawn service timed "
                    "out waiting for entity to appear in simulation under the name ",
                    ["a model needs a name"],
                ),
            )
        try:
            pose = compose(T_world_frame, _checked_pose(request.initial_pose))
            left_out = self._world.spawn(name, request.model_xml, pose)
        except G1DescriptionError as error:
            return SpawnModelResponse(False, f"SpawnModel: Failure - {error}")
        return SpawnModelResponse(
            True, self._say("SpawnModel: Successfully spawned entity", left_out)
        )

    def delete_model(self, request):
        """Remove a model; it is gone when this answers."""
        try:
            self._world.delete(request.model_name)
        except UnknownNameError:
            rospy.logerr("DeleteModel: model [%s] does not exist", request.model_name)
            return DeleteModelResponse(False, "DeleteModel: model does not exist")
        return DeleteModelResponse(True, "DeleteModel: successfully deleted model")

    def get_world_properties(self, _):
        """Tell the time and the models."""
        return GetWorldPropertiesResponse(
            sim_time=self._world.time_ns * 1e-9,
            model_names=list(self._world.models),
            rendering_enabled=True,
            success=True,
            status_message="GetWorldProperties: got properties",
        )

    def get_model_state(self, request):
        """Tell where a model is, seen from a frame."""
        name, frame = request.model_name, request.relative_entity_name
        response = _ModelStateResponse()
        if name not in self._world.models:
            response.status_message = "GetModelState: model does not exist"
            return response
        self._model_state_calls[name] += 1
        response.header.seq = self._model_state_calls[name]
        response.header.stamp = stamp_from_ns(self._world.time_ns)
        response.header.frame_id = frame
        try:
            pose, twist = self._world.model_state(name, frame)
        except UnknownNameError:
            response.status_message = (
                "GetModelState: reference relative_entity_name not found, did you "
                "forget to scope the body by model name?"
            )
            return response
        response.pose, response.twist = pose_from_array(pose), twist_from_array(twist)
        response.success = True
        response.status_message = "GetModelState: got properties"
        return response

    def set_model_state(self, request):
        """Put a model somewhere."""
        return SetModelStateResponse(*self.apply_model_state(request.model_state))

    def apply_model_state(self, state: ModelState) -> tuple[bool, str]:
        """Put a model somewhere; give success and status message."""
        name, frame = state.model_name, state.reference_frame
        if name not in self._world.models:
            rospy.logerr("Updating ModelState: model [%s] does not exist", name)
            return False, "SetModelState: model does not exist"
        try:
            pose, twist = _checked_pose(state.pose), _checked_twist(state.twist)
            self._world.set_model_state(name, pose, twist, frame)
        except UnknownNameError:
            rospy.logerr(
                "Updating ModelState: for model[%s], specified reference frame entity "
                "[%s] does not exist",
                name,
                frame,
            )
            return (
                False,
                "SetModelState: specified reference frame entity does not exist",
            )
        except InvalidValueError as error:
            refusal = f"SetModelState: refused, {error}"
            rospy.logwarn_throttle_identical(1.0, refusal)
            return False, refusal
        clause = ""
        if self._world.physics == "kinematic" and twist.any():
            clause = "the twist is ignored, physics is kinematic"
        return True, self._say("SetModelState: set model state done", [clause])

    def pause_physics(self, _):
        """Let time stand still."""
        self.paused = True
        return EmptyResponse()

    def unpause_physics(self, _):
        """Let time run."""
        self.paused = False
        return EmptyResponse()

    def reset_simulation(self, _):
        """Begin again: time zero, models as spawned, joints at zero."""
        self._world.reset()
        return EmptyResponse()

    def reset_world(self, _):
        """Put the models back where they were spawned, joints as they are."""
        self._world.reset_models()
        return EmptyResponse()


def _unscoped(model, names, positions):
    """Find what joints a list means: ``joint`` wins over ``model::joint``.

    Of equal names the last wins; whatever is neither stays as it is.
    """
    scope = model + SCOPE
    scoped, plain = {}, {}
    for name, position in zip(names, positions):
        if name.startswith(scope):
            scoped[name[len(scope) :]] = position
        else:
            plain[name] = position
    return {**scoped, **plain}


def _clauses(model: str, report: Report) -> list[str]:
    """Tell what was not obeyed to the letter."""
    clauses = []
    if report.unknown:
        names = ", ".join(name or "''" for name in report.unknown)
        clauses.append(f"ignored, no movable joint of {model}: {names}")
    if report.clamped:
        values = (f"{name} to {value!r}" for name, value in report.clamped.items())
        clauses.append(f"clamped to the limits: {', '.join(values)}")
    return clauses


def _checked_pose(message) -> np.ndarray:
    """Read a pose as Gazebo does: a zero quaternion is the identity."""
    pose = _checked("pose", pose_to_array(message))
    pose[3:] = normalized(pose[3:])
    return pose


def _checked_twist(message) -> np.ndarray:
    """Read a twist."""
    return _checked("twist", twist_to_array(message))


def _checked(what: str, numbers: np.ndarray) -> np.ndarray:
    """Check that numbers are some that a model can have.

    Raises:
        InvalidValueError: If one is NaN, infinite or beyond ``LARGEST``.
    """
    if not (np.abs(numbers) <= LARGEST).all():
        raise InvalidValueError(
            f"the {what} {numbers.tolist()} has a number beyond +-{LARGEST:g}"
        )
    return numbers
