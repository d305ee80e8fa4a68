"""The service that lets a model go through a motion. Gazebo does not have it.

Everything here runs in the simulator's loop, between two steps.
"""

from __future__ import annotations

import numpy as np

from g1_description.core.errors import (
    InvalidValueError,
    MotionError,
    UnknownNameError,
)
from g1_description.core.motion.trajectory import Trajectory
from g1_description.core.text import listed
from g1_description.msg import ModelTrajectory
from g1_description.ros.wire.conversions import stamp_from_ns
from g1_description.sim.model import Model
from g1_description.srv import SetModelTrajectory, SetModelTrajectoryResponse

from .base import SteppedServices, clamped

FAR = 0.3
"""Distance to a first sample from which it is told, in [rad] or [m]."""


class TrajectoryServices(SteppedServices):
    """Let models go through motions, and stop them."""

    def table(self):
        """List the services: name under the node, type, and what answers."""
        return (("set_model_trajectory", SetModelTrajectory, self.set_trajectory),)

    def set_trajectory(self, request):
        """Let a model go through a motion, or stop it."""
        response = SetModelTrajectoryResponse()
        try:
            start, details = self._act(request.trajectory)
        except (InvalidValueError, MotionError, UnknownNameError) as error:
            response.status_message = f"SetModelTrajectory: refused, {error}"
            return response
        message = "SetModelTrajectory: success"
        response.status_message = self._messages.compose(message, details)
        response.start = stamp_from_ns(start)
        response.success = True
        return response

    def apply(self, message: ModelTrajectory) -> str:
        """Do what a message on the topic wants; return what was not done exactly so.

        Raises:
            InvalidValueError: If that cannot be done; nothing is changed.
        """
        try:
            _, details = self._act(message)
        except (MotionError, UnknownNameError) as error:
            raise InvalidValueError(str(error)) from error
        return self._messages.compose("", details)

    def _act(self, message: ModelTrajectory) -> tuple[int, list[str]]:
        """Do what a message wants; return when it begins, in [ns], and details."""
        model = self._world.model(message.model_name)
        if not message.times:
            self._world.motions.stop(model, message.joint_names)
            return self._world.time_ns, []
        trajectory = _trajectory(message)
        start = message.start.to_nsec() or self._next_ns
        is_new = self._world.is_dynamic and start >= self._world.time_ns
        jump = _jump(model, trajectory) if is_new else ""
        report = self._world.motions.play(model, trajectory, start)
        if start <= self._world.time_ns:
            self._world.motions.step(self._world.time_ns)
        details = [clamped(model, report), jump]
        if report.unknown:
            names = listed(report.unknown)
            details.append(f"ignored, no movable joint of {model.name}: {names}")
        if trajectory.base_poses is not None and self._world.is_dynamic:
            details.append("the base is left to physics")
        return start, details

    @property
    def _next_ns(self) -> int:
        """The time at which something set now shows, in [ns]."""
        now = self._world.time_ns
        return now if self._stepper.paused else now + self._world.properties.step_ns


def _jump(model: Model, trajectory: Trajectory) -> str:
    """Say which joint the first sample is far from; empty if none, or if that is meant.

    A single configuration is a command; a later first sample leaves time to go there.
    """
    if len(trajectory.times) == 1 or trajectory.times[0] > 0.0:
        return ""
    first = dict(zip(trajectory.joint_names, trajectory.positions[0].tolist()))
    wanted = np.array([first.get(n, np.nan) for n in model.joint_names])
    wanted = np.minimum(np.maximum(wanted, model.lower), model.upper)
    apart = np.abs(wanted - model.target)
    jumps = {n: d for n, d in zip(model.joint_names, apart.tolist()) if n in first}
    name = max(jumps, key=lambda n: jumps[n], default="")
    if not name or jumps[name] <= FAR:
        return ""
    return (
        f"motors take joints to the first sample at once: {name} is {jumps[name]:.2f} "
        "away from it"
    )


def _trajectory(message: ModelTrajectory) -> Trajectory:
    """Read a motion.

    Raises:
        MotionError: If its numbers are not those of a motion.
    """
    n_samples, n_joints = len(message.times), len(message.joint_names)
    positions = _rows("positions", message.positions, n_samples, n_joints)
    velocities, bases = message.velocities, message.base_poses
    return Trajectory(
        np.array(message.times),
        tuple(message.joint_names),
        positions,
        _rows("velocities", velocities, n_samples, n_joints) if velocities else None,
        _rows("base_poses", bases, n_samples, 7) if bases else None,
    )


def _rows(what: str, numbers, n_samples: int, width: int) -> np.ndarray:
    """Arrange numbers in rows, shape (n_samples, width)."""
    if len(numbers) != n_samples * width:
        raise MotionError(
            f"there are {len(numbers)} {what} for {n_samples} times and {width} columns"
        )
    return np.array(numbers, dtype=float).reshape(n_samples, width)
