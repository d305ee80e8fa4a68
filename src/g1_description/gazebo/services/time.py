"""Services that let time run, stand still or begin again, or some steps pass.

Everything here runs in the simulator's loop, between two steps.
"""

from __future__ import annotations

from std_srvs.srv import Empty, EmptyResponse

from g1_description.errors import InvalidValueError, UnknownNameError
from g1_description.gazebo.services.base import (
    SteppedServices,
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
from g1_description.srv import Step, StepModel, StepModelResponse, StepResponse
from g1_description.text import listed, similar_first


class TimeServices(SteppedServices):
    """Pause, go on, begin again."""

    def table(self):
        """List the services: name under the node, type, and what answers."""
        return (
            ("pause_physics", Empty, self.pause),
            ("unpause_physics", Empty, self.unpause),
            ("reset_simulation", Empty, self.reset_simulation),
            ("reset_world", Empty, self.reset_world),
        )

    def pause(self, _):
        """Pause, also where steps were requested."""
        self._stepper.paused = True
        self._stepper.end("pause_physics")
        return EmptyResponse()

    def unpause(self, _):
        """Let time run."""
        self._stepper.paused = False
        return EmptyResponse()

    def reset_simulation(self, _):
        """Begin again: time zero, models as spawned, joints at zero."""
        self._world.reset()
        self._stepper.end("reset_simulation")
        return EmptyResponse()

    def reset_world(self, _):
        """Put the models back where they were spawned, joints as they are."""
        self._world.reset_models()
        self._stepper.end("reset_world")
        return EmptyResponse()


class StepServices(SteppedServices):
    """Let steps pass, from a state that is given or the one there is.

    Gazebo does not have these.
    """

    def table(self):
        """List the services: name under the node, type, and what answers."""
        return (
            ("step", Step, self.step),
            ("step_model", StepModel, self.step_model),
        )

    def step(self, request):
        """Let steps pass; answered when they have."""

        def respond(success, outcome):
            return StepResponse(success, f"Step: {outcome}")

        refusal = self._refusal(request.steps)
        if refusal:
            return respond(False, refusal)
        if not request.steps:
            return respond(True, "0 steps done")
        return self._stepper.request(request.steps, respond)

    def step_model(self, request):
        """Set a model, let steps pass, and answer with its state."""
        refusal = request.steps and self._refusal(request.steps)
        if refusal:
            return _refused(f"StepModel: {refusal}")
        try:
            model = self._world.model(request.model_name)
            report = self._set(model, request)
        except (UnknownNameError, InvalidValueError) as error:
            return _refused(f"StepModel: refused, {error}")

        def respond(success, outcome):
            details = remarks(model, report)
            message = "" if success else f"StepModel: {outcome}"
            response = self._state(
                model, success, self._messages.compose(message, details)
            )
            response.clamped = [*report.clamped]
            return response

        if not request.steps:
            return respond(True, "0 steps done")
        return self._stepper.request(request.steps, respond)

    def _refusal(self, steps: int) -> str:
        """Say why steps cannot pass; empty if they can."""
        if not self._stepper.paused:
            return "refused, time is running; pause_physics makes it stand still"
        if steps and not self._world.properties.step_ns:
            return "refused, time_step is 0"
        return ""

    def _set(self, model: Model, request) -> Report:
        """Set a model's base and joints; nothing if one of them cannot be.

        Returns:
            What was not obeyed to the letter.

        Raises:
            UnknownNameError: If it has no such joint.
            InvalidValueError: If a number is not one that a model can have.
        """
        names, positions = request.joint_names, request.joint_positions
        if len(names) != len(positions):
            raise InvalidValueError(
                f"there are {len(names)} joint_names and {len(positions)} "
                "joint_positions"
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
        if pose is not None:
            self._world.set_root_state(model, pose, model.twist * 0.0)
        return self._world.set_joint_positions(model.name, dict(zip(names, positions)))

    def _state(self, model: Model, success: bool, message: str) -> StepModelResponse:
        """Return a model's state; none if it was deleted."""
        if self._world.models.get(model.name) is not model:
            reasons = filter(None, (message, f"StepModel: {model.name} was deleted"))
            return _refused("; ".join(reasons))
        response = StepModelResponse(success=success, status_message=message)
        states = response.joint_states
        states.header.stamp = stamp_from_ns(self._world.time_ns)
        states.name = list(model.joint_names)
        states.position = model.position.tolist()
        states.velocity = model.velocity.tolist()
        row = model.root_row
        response.base_pose = pose_from_array(model.poses[row])
        response.base_twist = twist_from_array(model.twists[row])
        return response


def _refused(message: str) -> StepModelResponse:
    """Refuse, without a state."""
    return StepModelResponse(success=False, status_message=message)
