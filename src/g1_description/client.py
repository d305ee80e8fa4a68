"""A client that controls the simulator and its time, step by step.

Calls: step_model (g1_description/StepModel), set_model_trajectory
    (g1_description/SetModelTrajectory), get_physics_properties
    (gazebo_msgs/GetPhysicsProperties), pause_physics, unpause_physics and
    reset_simulation (std_srvs/Empty), set_anchor (g1_description/SetAnchor) of the
    simulator; get_history (g1_description/GetHistory) of the bridge
"""

from __future__ import annotations

import math
import operator
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from gazebo_msgs.srv import GetPhysicsProperties
from std_srvs.srv import Empty

from g1_description.errors import InvalidValueError
from g1_description.former import former_arguments
from g1_description.motion.history import CommandStream
from g1_description.motion.motion import Motion, MotionLike, as_motion
from g1_description.robot.arrays import (
    JointValues,
    check_names,
    named_positions,
    one_pose,
)
from g1_description.robot.state import RobotState
from g1_description.ros.connection import Connection
from g1_description.ros.conversions import (
    model_trajectory,
    pose_from_array,
    pose_to_array,
    twist_to_array,
)
from g1_description.ros.history import fetch_commands, fetch_history
from g1_description.ros.waiting import (
    MASTER_PERIOD,
    NoAnswerError,
    RefusedError,
    wait_until,
)
from g1_description.srv import SetAnchor, SetModelTrajectory, StepModel

MOST = (1 << 32) - 1
"""Largest uint32."""


def count(label: str, number: Any, least: int) -> int:
    """Check a count.

    Raises:
        InvalidValueError: If it is not a whole number of at least ``least``.
    """
    try:
        found = operator.index(number)
    except TypeError:
        found = -1
    if not least <= found <= MOST:
        raise InvalidValueError(
            f"{label} must be a whole number of at least {least} (got {number!r})."
        )
    return found


@dataclass(frozen=True, eq=False)
class SteppedState(RobotState):
    """The state of a robot after steps, and deviations from the request.

    Joints are in the order of the client's ``joint_names``. The base is the root link.
    """

    note: str = ""
    """Deviations from the request, such as clamped positions."""

    clamped: tuple[str, ...] = ()
    """Joints whose positions were clamped to their limits."""

    @property
    def time_ns(self) -> int:
        """The stamp, in simulated time, in [ns]."""
        return self.stamp

    @property
    def base(self) -> np.ndarray | None:
        """Pose of the root link in the world, shape (7,)."""
        return self.base_pose


TIMEOUT = 10.0
"""Longest wait for master, simulator and robot, in [s]: they may be starting."""


class Client:
    """A robot in the simulator, and control of simulated time.

    Time advances only by the steps requested here, so the same calls after a reset give
    bit-identical states. The program need not be a node.
    """

    def __init__(
        self, model: str = "g1_robot", gazebo: str = "/gazebo", timeout: float = TIMEOUT
    ) -> None:
        """Connect, and pause time.

        Args:
            model: Name of the robot in the simulated world.
            gazebo: Namespace of the simulator.
            timeout: Longest wait for master, simulator and robot, in [s].

        Raises:
            InvalidValueError: If the timeout is negative or not finite.
            NoAnswerError: If one of them does not answer in time.
        """
        self._model = model
        if not 0.0 <= timeout < math.inf:
            raise InvalidValueError(f"timeout must be at least 0 s (got {timeout:g}).")
        self._services = Connection(gazebo, timeout)
        try:
            self._services.wait_for("step_model")
            first = self._wait_for_robot(timeout)
            self._was_running = not self._physics().pause
            self._services.call("pause_physics", Empty)
        except BaseException:
            self._services.close()
            raise
        self.joint_names: tuple[str, ...] = tuple(first.joint_states.name)
        """The movable joints in the order of the URDF, as in all arrays."""

    def __enter__(self) -> Client:
        """Return this client, for a with statement."""
        return self

    def __exit__(self, *_: object) -> None:
        """Close the client."""
        self.close()

    def close(self) -> None:
        """Disconnect; resume time if it ran before.

        Raises:
            NoAnswerError: If the simulator does not answer.
        """
        try:
            if self._was_running:
                self._was_running = False
                self._services.call("unpause_physics", Empty)
        finally:
            self._services.close()

    @property
    def time_step(self) -> float:
        """Length of a step in simulated time, in [s].

        Raises:
            NoAnswerError: If the simulator does not answer.
        """
        return self._physics().time_step

    def state(self) -> SteppedState:
        """Return the robot's current state; no time passes.

        Returns:
            The state; the pose and the twist of its root link are in the world.

        Raises:
            NoAnswerError: If the simulator does not answer.
        """
        return self.step(0)

    def set(
        self, positions: JointValues | None = None, base: Any = None
    ) -> SteppedState:
        """Set joints and base immediately; no time passes.

        Args:
            positions: Positions of all joints as an array, or of some as a
                dictionary, in [rad] or [m]; other joints stay. Motors hold them.
            base: Pose of the root link in the world, shape (7,), then at rest; by
                default it stays.

        Returns:
            The new state.

        Raises:
            G1DescriptionError: If the request is invalid; nothing is changed then.
        """
        return self.step(0, positions, base)

    def step(
        self, n: int = 1, positions: JointValues | None = None, base: Any = None
    ) -> SteppedState:
        """Advance simulated time by physics steps.

        Args:
            n: Number of steps.
            positions: Set before the first step, as by ``set``, in [rad] or [m].
            base: Pose of the root link in the world, set before the first step, too.

        Returns:
            The state after the last step.

        Raises:
            G1DescriptionError: If the request is invalid; nothing is changed then.
        """
        names, numbers = named_positions(positions, self.joint_names)
        fields: dict[str, Any] = {"set_base": base is not None}
        if base is not None:
            fields["base_pose"] = pose_from_array(one_pose(base))
        answer = self._services.checked(
            "step_model",
            StepModel,
            model_name=self._model,
            joint_names=names,
            joint_positions=numbers,
            steps=count("steps", n, 0),
            **fields,
        )
        joints = answer.joint_states
        return SteppedState(
            joints.header.stamp.to_nsec(),
            self.joint_names,
            np.array(joints.position),
            np.array(joints.velocity),
            pose_to_array(answer.base_pose),
            twist_to_array(answer.base_twist),
            note=answer.status_message,
            clamped=tuple(answer.clamped),
        )

    def command(self, positions: JointValues) -> str:
        """Command joint positions from the next step on.

        In ``hold`` they are the motors' targets; in other physics joints are set.

        Args:
            positions: Positions of all joints as an array, or of some as a
                dictionary, in [rad] or [m].

        Returns:
            Deviations from the request; may be empty.

        Raises:
            G1DescriptionError: If the request is invalid.
        """
        names, numbers = named_positions(positions, self.joint_names)
        return self.follow(Motion(np.zeros(1), names, np.array([numbers])))

    @former_arguments(trajectory="motion")
    def follow(self, motion: MotionLike) -> str:
        """Start a motion now; it advances with the following steps.

        Args:
            motion: The motion, or a result that has one, from its time 0 on. Its base,
                in the world, is used only in ``kinematic`` physics.

        Returns:
            Deviations from the request; may be empty.

        Raises:
            G1DescriptionError: If the request is invalid.
        """
        motion = as_motion(motion)
        check_names(motion.joint_names, self.joint_names)
        message = model_trajectory(self._model, motion)
        answer = self._services.checked(
            "set_model_trajectory", SetModelTrajectory, trajectory=message
        )
        return answer.status_message

    @former_arguments(trajectory="motion")
    def play(self, motion: MotionLike, every: int = 1) -> Motion:
        """Play a motion to its end.

        Args:
            motion: The motion, as for ``follow``.
            every: Steps between two returned samples.

        Returns:
            The measured motion of the robot, as by ``record``.

        Raises:
            RefusedError: If the length of a step is 0.
            G1DescriptionError: If the request is invalid.
        """
        count("every", every, 1)
        time_step = self.time_step
        if not time_step:
            raise RefusedError("time_step is 0: a motion would not advance.")
        motion = as_motion(motion)
        self.follow(motion)
        # A nanosecond less: a motion of 0.3 s ends with step 300 of 0.001 s.
        steps = math.ceil((motion.rest_time - 1e-9) / time_step)
        return self.record(max(steps, 1), every)

    def record(self, n: int, every: int = 1) -> Motion:
        """Advance simulated time, and record the states.

        Args:
            n: Number of steps.
            every: Steps between two states; the last one is always recorded.

        Returns:
            The states as a motion that starts with the current one, at time 0; its base
            poses are those of the root link in the world.

        Raises:
            G1DescriptionError: If the request is invalid.
        """
        left = count("steps", n, 1)
        count("every", every, 1)
        states = [self.state()]
        while left:
            states.append(self.step(min(every, left)))
            left -= min(every, left)
        return Motion(
            1e-9 * np.array([state.stamp - states[0].stamp for state in states]),
            self.joint_names,
            np.array([state.positions for state in states]),
            np.array([state.velocities for state in states]),
            np.array([state.base for state in states]),
        )

    def history(self, seconds: float, namespace: str = "") -> Motion:
        """Return the robot's last states, which its bridge keeps.

        Args:
            seconds: Their simulated time, in [s]; the bridge may have less.
            namespace: Namespace of the robot's topics.

        Returns:
            The states as a motion that starts at time 0, its base in the map; its
            ``notes`` name missing ones.

        Raises:
            InvalidValueError: If ``seconds`` is not positive and finite.
            NoAnswerError: If there is no bridge.
            RefusedError: If it keeps no history, or has no state.
        """
        if not 0.0 < seconds < math.inf:
            raise InvalidValueError(f"seconds must be greater than 0 (got {seconds}).")
        stretch, note = fetch_history(seconds, namespace)
        return replace(stretch.motion(), notes=(note,) if note else ())

    def commands(self, seconds: float, namespace: str = "") -> Sequence[CommandStream]:
        """Return the last commands that the robot's bridge received.

        Args:
            seconds: Their simulated time, in [s]; the bridge may have less.
            namespace: Namespace of the robot's topics.

        Returns:
            Equal commands that followed each other within a second are one entry, with
            sender, topic and joints in its ``command``, the ``stamps`` of each in [ns]
            and ``positions`` in [rad] or [m], shape (count, n_names).

        Raises:
            InvalidValueError: If ``seconds`` is not positive and finite.
            NoAnswerError: If there is no bridge.
            RefusedError: If it keeps no history, or has no state.
        """
        if not 0.0 < seconds < math.inf:
            raise InvalidValueError(f"seconds must be greater than 0 (got {seconds}).")
        return fetch_commands(seconds, namespace)

    def anchor(self, link: str = "") -> str:
        """Keep a link at its place while joints move; the base follows.

        Args:
            link: A link, or ``lowest_foot`` for the lower one of the feet; empty: none.

        Returns:
            The anchor before; empty: none.

        Raises:
            G1DescriptionError: If there is no such link, or physics is not
                ``kinematic``.
        """
        answer = self._services.checked(
            "set_anchor", SetAnchor, model_name=self._model, link_name=link
        )
        return answer.previous

    def reset(self) -> SteppedState:
        """Reset the simulation: time zero, models as spawned.

        Returns:
            The state after the reset.

        Raises:
            G1DescriptionError: If the simulator does not answer.
        """
        self._services.call("reset_simulation", Empty)
        return self.state()

    def _wait_for_robot(self, timeout: float) -> Any:
        """Wait until the robot is spawned; return its state."""
        why = ""

        def call() -> Any:
            nonlocal why
            try:
                return self._services.checked(
                    "step_model", StepModel, model_name=self._model
                )
            except RefusedError as error:
                why = str(error)
                return None

        answer = wait_until(call, timeout, None, MASTER_PERIOD)
        if answer is None:
            raise NoAnswerError(f"No robot within {timeout:g} s: {why}")
        return answer

    def _physics(self) -> Any:
        return self._services.call("get_physics_properties", GetPhysicsProperties)
