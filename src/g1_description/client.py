"""The stand-in under a program's control: it steps when the program says so.

Calls: step_model (g1_description/StepModel), set_model_trajectory
    (g1_description/SetModelTrajectory), get_physics_properties
    (gazebo_msgs/GetPhysicsProperties), pause_physics, unpause_physics and
    reset_simulation (std_srvs/Empty) of the stand-in
"""

from __future__ import annotations

import math
import operator
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from gazebo_msgs.srv import GetPhysicsProperties
from std_srvs.srv import Empty

from g1_description.api import JointValues, as_array, as_poses, check_names
from g1_description.errors import InvalidValueError
from g1_description.motion.trajectory import Trajectory
from g1_description.robot.state import RobotState
from g1_description.ros.connection import Connection
from g1_description.ros.conversions import (
    model_trajectory,
    pose_from_array,
    pose_to_array,
    twist_to_array,
)
from g1_description.ros.waiting import (
    MASTER_PERIOD,
    NoAnswerError,
    RefusedError,
    wait_until,
)
from g1_description.srv import SetModelTrajectory, StepModel

MOST = (1 << 32) - 1
"""The largest count that a message holds."""


def named_positions(
    positions: JointValues | None, joints: Sequence[str]
) -> tuple[tuple[str, ...], list[float]]:
    """Name the joints of positions; those that are not given are not named.

    Args:
        positions: Of all joints as an array, or of some as a dictionary; None: of none.
        joints: Names of the robot's joints.

    Returns:
        Names and positions.

    Raises:
        G1DescriptionError: If they are none of one configuration of this robot.
    """
    if positions is None:
        return (), []
    array = as_array(positions, joints, np.zeros(len(joints)))
    if array.ndim != 1:
        raise InvalidValueError(
            f"Positions of shape {array.shape} are many configurations; the simulator "
            "takes one at a time."
        )
    names = tuple(positions) if isinstance(positions, Mapping) else tuple(joints)
    return names, [float(array[joints.index(name)]) for name in names]


def one_pose(base: Any) -> np.ndarray:
    """Check the pose of a base, shape (7,).

    Raises:
        InvalidValueError: If it is not a single pose.
    """
    pose = as_poses(base)
    if pose.ndim != 1:
        raise InvalidValueError(
            f"A base of shape {pose.shape} is many poses; the simulator takes one at a "
            "time."
        )
    return pose


def count(what: str, number: Any, least: int) -> int:
    """Check a count.

    Raises:
        InvalidValueError: If it is not.
    """
    try:
        found = operator.index(number)
    except TypeError:
        found = -1
    if not least <= found <= MOST:
        raise InvalidValueError(
            f"{what} is {number!r}; it is a whole number from {least} on."
        )
    return found


@dataclass(frozen=True, eq=False)
class SteppedState(RobotState):
    """The state of a robot after steps, and what was not done before them.

    Joints are in the order of the client's ``joint_names``. The base is the root link.
    """

    note: str = ""
    """What was not done as requested, such as positions that were clamped."""

    clamped: tuple[str, ...] = ()
    """The joints whose positions were clamped to their limits."""

    @property
    def time_ns(self) -> int:
        """The stamp, in simulated time, in [ns]."""
        return self.stamp

    @property
    def base(self) -> np.ndarray | None:
        """Pose of the root link in the world, shape (7,)."""
        return self.base_pose


TIMEOUT = 10.0
"""Longest wait for master, stand-in and robot, in [s]: they may be starting."""


class Client:
    """A robot in the stand-in, and its simulated time.

    Time stands still but for the steps that are requested here, so the same calls after
    a reset give the same states to the last bit. The program need not be a node.
    """

    def __init__(
        self, model: str = "g1_robot", gazebo: str = "/gazebo", timeout: float = TIMEOUT
    ) -> None:
        """Connect, and let time stand still.

        Args:
            model: Name of the robot in the simulated world.
            gazebo: Namespace of the stand-in.
            timeout: Longest wait for master, stand-in and robot, in [s].

        Raises:
            NoAnswerError: If one of them is not there in time.
        """
        self._model = model
        self._services = Connection(gazebo, timeout)
        self._services.wait_for("step_model")
        first = self._wait_for_robot(timeout)
        self.joint_names: tuple[str, ...] = tuple(first.joint_states.name)
        """The movable joints, in the order of all arrays; that of the URDF."""
        self._was_running = not self._physics().pause
        self._services.call("pause_physics", Empty)

    def __enter__(self) -> Client:
        """Be used in a with statement."""
        return self

    def __exit__(self, *_: object) -> None:
        """End."""
        self.close()

    def close(self) -> None:
        """Disconnect; time runs again if it did before."""
        try:
            if self._was_running:
                self._was_running = False
                self._services.call("unpause_physics", Empty)
        finally:
            self._services.close()

    @property
    def time_step(self) -> float:
        """Simulated time of a step, in [s]."""
        return self._physics().time_step

    def state(self) -> SteppedState:
        """Return where the robot is.

        Raises:
            NoAnswerError: If the stand-in does not answer.
        """
        return self.step(0)

    def set(
        self, positions: JointValues | None = None, base: Any = None
    ) -> SteppedState:
        """Set joints and base at once; no time passes.

        Args:
            positions: Of all joints as an array, or of some as a dictionary, in [rad]
                or [m]; other joints stay. Motors hold what was set.
            base: Pose of the root link in the world, shape (7,), then at rest; by
                default it stays.

        Returns:
            The state after that.

        Raises:
            G1DescriptionError: If that cannot be done, and then nothing is changed.
        """
        return self.step(0, positions, base)

    def step(
        self, n: int = 1, positions: JointValues | None = None, base: Any = None
    ) -> SteppedState:
        """Let physics steps pass.

        Args:
            n: How many.
            positions: Set first, as by ``set``.
            base: Set first, too.

        Returns:
            The state after them.

        Raises:
            G1DescriptionError: If that cannot be done, and then nothing is changed.
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
        """Give joints new positions from the next step on.

        In ``hold`` their motors go there, in other physics the joints are there at
        once.

        Args:
            positions: Of all joints as an array, or of some as a dictionary, in [rad]
                or [m].

        Returns:
            What is not done as requested; may be empty.

        Raises:
            G1DescriptionError: If that cannot be done.
        """
        names, numbers = named_positions(positions, self.joint_names)
        return self.follow(Trajectory(np.zeros(1), names, np.array([numbers])))

    def follow(self, trajectory: Trajectory) -> str:
        """Begin a motion now; it goes on with the steps that follow.

        Args:
            trajectory: Its times count from now. Its base counts only where physics
                does not move the robot.

        Returns:
            What is not done as requested; may be empty.

        Raises:
            G1DescriptionError: If that cannot be done.
        """
        check_names(trajectory.joint_names, self.joint_names)
        message = model_trajectory(self._model, trajectory)
        answer = self._services.checked(
            "set_model_trajectory", SetModelTrajectory, trajectory=message
        )
        return answer.status_message

    def play(self, trajectory: Trajectory, every: int = 1) -> Trajectory:
        """Let the robot go through a motion.

        Args:
            trajectory: As for ``follow``.
            every: Steps between two samples of what is returned.

        Returns:
            What the robot did from now until the motion's end.

        Raises:
            G1DescriptionError: If that cannot be done.
        """
        count("every", every, 1)
        self.follow(trajectory)
        # A nanosecond less: a motion of 0.3 s ends with step 300 of 0.001 s.
        steps = math.ceil((trajectory.rest_time - 1e-9) / self.time_step)
        return self.record(max(steps, 1), every)

    def record(self, n: int, every: int = 1) -> Trajectory:
        """Let physics steps pass, and keep the states.

        Args:
            n: How many steps.
            every: Steps between two states; the last one is kept in any case.

        Returns:
            The states as a motion, the present one first, whose times count from now.

        Raises:
            G1DescriptionError: If steps cannot be done.
        """
        left = count("steps", n, 1)
        count("every", every, 1)
        states = [self.state()]
        while left:
            states.append(self.step(min(every, left)))
            left -= min(every, left)
        return Trajectory(
            1e-9 * np.array([state.stamp - states[0].stamp for state in states]),
            self.joint_names,
            np.array([state.positions for state in states]),
            np.array([state.velocities for state in states]),
            np.array([state.base for state in states]),
        )

    def reset(self) -> SteppedState:
        """Begin again: time zero, models as they were spawned.

        Returns:
            The state then.

        Raises:
            G1DescriptionError: If the stand-in does not answer.
        """
        self._services.call("reset_simulation", Empty)
        return self.state()

    def _wait_for_robot(self, timeout: float) -> Any:
        """Wait until the robot is in the world; return its state."""
        why = ""

        def ask() -> Any:
            nonlocal why
            try:
                return self._services.checked(
                    "step_model", StepModel, model_name=self._model
                )
            except RefusedError as error:
                why = str(error)
                return None

        answer = wait_until(ask, timeout, None, MASTER_PERIOD)
        if answer is None:
            raise NoAnswerError(f"After {timeout:g} s there is no robot: {why}")
        return answer

    def _physics(self) -> Any:
        """Return the physics' numbers."""
        return self._services.call("get_physics_properties", GetPhysicsProperties)
