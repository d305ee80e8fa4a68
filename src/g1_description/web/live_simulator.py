"""The simulator, as shown and controlled by a page.

Calls, below the simulator's name: get_physics_properties
    (gazebo_msgs/GetPhysicsProperties), pause_physics, unpause_physics, reset_world
    (std_srvs/Empty), step (g1_description/Step), set_real_time_factor
    (g1_description/SetRealTimeFactor), set_gantry (g1_description/SetGantry),
    set_model_configuration (gazebo_msgs/SetModelConfiguration), set_model_state
    (gazebo_msgs/SetModelState)
"""

from __future__ import annotations

import threading
import time
from typing import Any

import rosgraph
import rospy
from gazebo_msgs.msg import ModelState
from gazebo_msgs.srv import (
    GetPhysicsProperties,
    SetModelConfiguration,
    SetModelState,
)
from std_srvs.srv import Empty

from g1_description.choices import ENGINES
from g1_description.errors import G1DescriptionError
from g1_description.robot.state import RobotState
from g1_description.ros.connection import Connection
from g1_description.ros.conversions import pose_from_array
from g1_description.ros.waiting import SERVICE_ERRORS
from g1_description.srv import SetGantry, SetRealTimeFactor, Step

PERIOD = 1.0
"""Polling period, in [s]."""

SILENCE = 5.0
"""Time without an answer after which the simulator is shown as not responding, in
[s]."""

TIMEOUT = 10.0
"""Longest wait for a service, in [s]: machines may be busy."""


class LiveSimulator:
    """A simulator with Gazebo's services."""

    def __init__(self, gazebo: str) -> None:
        self.name = "/" + gazebo.strip("/")
        self._connection = Connection(gazebo, TIMEOUT)
        self._lock = threading.Lock()
        self._watched = threading.Event()
        self._paused: bool | None = None
        self._answered = 0.0
        """When it last answered, on the monotonic clock, in [s]."""
        self._physics = ""
        self.is_stand_in = True
        """False once another simulator has answered: the real Gazebo."""
        self._clock: tuple[float, float] | None = None
        self._factor: float | None = None
        threading.Thread(target=self._ask_forever, daemon=True).start()

    def watch(self, is_watched: bool) -> None:
        """Start or stop polling."""
        if is_watched:
            self._watched.set()
        else:
            self._watched.clear()

    def _ask_forever(self) -> None:
        """Poll the simulator."""
        # A separate connection: an answer may take long.
        properties = rospy.ServiceProxy(
            f"{self.name}/get_physics_properties", GetPhysicsProperties
        )
        while not rospy.core.is_shutdown_requested():
            self._watched.wait()
            try:
                self._paused = bool(properties().pause)
                physics = str(rospy.get_param(f"{self.name}/physics", ""))
                engine = rospy.get_param(f"{self.name}/engine", ENGINES[0])
                is_usual = physics == "kinematic" or engine == ENGINES[0]
                self._physics = physics if is_usual else f"{physics}, {engine}"
                self.is_stand_in = self._has_steps()
                self._answered = time.monotonic()
            except (G1DescriptionError, *SERVICE_ERRORS):
                self._paused = None
            self._measure()
            time.sleep(PERIOD)

    def _has_steps(self) -> bool:
        """Return whether the simulator offers steps; the real Gazebo does not."""
        try:
            rosgraph.Master(rospy.get_name()).lookupService(f"{self.name}/step")
        except rosgraph.MasterError:
            return False
        return True

    def _measure(self) -> None:
        """Measure the real-time factor."""
        now = time.monotonic(), rospy.get_time()
        if self._clock is not None and now[0] > self._clock[0]:
            passed = now[1] - self._clock[1]
            self._factor = max(passed, 0.0) / (now[0] - self._clock[0])
        self._clock = now

    def status(self) -> str:
        """Format physics, time and speed in a line."""
        if self._paused is None or time.monotonic() > self._answered + SILENCE:
            return f"*{self.name} does not answer.*"
        parts = [self._physics and f"**{self._physics}**", f"{rospy.get_time():.1f} s"]
        if self._paused:
            parts.append("paused")
        elif self._factor is not None:
            parts.append(f"x {self._factor:.2f}")
        return " · ".join(filter(None, parts))

    @property
    def is_paused(self) -> bool:
        """Whether simulated time is paused."""
        return bool(self._paused)

    @property
    def is_kinematic(self) -> bool:
        """Whether configurations are set without physics."""
        return self._physics == "kinematic"

    def pause(self) -> None:
        """Pause simulated time."""
        self.call("pause_physics", Empty)
        self._paused = True

    def go_on(self) -> None:
        """Resume simulated time."""
        self.call("unpause_physics", Empty)
        self._paused = False

    def step(self, steps: int) -> None:
        """Run a number of steps while time is paused."""
        self.call("step", Step, steps=steps)

    def set_speed(self, factor: float) -> None:
        """Set the speed of simulated time."""
        self.call("set_real_time_factor", SetRealTimeFactor, real_time_factor=factor)

    def reset(self) -> None:
        """Reset the world."""
        self.call("reset_world", Empty)

    def hang(self, robot: str, is_on: bool, length: float) -> None:
        """Hang a robot on a rope of a length in [m], or let it go."""
        self.call(
            "set_gantry", SetGantry, model_name=robot, enable=is_on, length=length
        )

    def place(self, robot: str, state: RobotState) -> None:
        """Put a robot to a state, at rest, while time is paused."""
        was_paused = self.call("get_physics_properties", GetPhysicsProperties).pause
        self.pause()
        try:
            self.call(
                "set_model_configuration",
                SetModelConfiguration,
                model_name=robot,
                joint_names=state.names,
                joint_positions=state.positions.tolist(),
            )
            if state.base_pose is not None:
                pose = pose_from_array(state.base_pose)
                base = ModelState(model_name=robot, pose=pose)
                self.call("set_model_state", SetModelState, model_state=base)
        finally:
            if not was_paused:
                self.go_on()

    def call(self, service: str, kind: type, **fields) -> Any:
        """Call a service; return its answer.

        Raises:
            G1DescriptionError: If it fails or is not answered.
        """
        connection = self._connection
        with self._lock:
            connection.wait_for(service)
            call = connection.call if kind is Empty else connection.checked
            return call(service, kind, **fields)
