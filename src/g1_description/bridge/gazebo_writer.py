"""Samples of motions to a simulator that only takes configurations, as Gazebo."""

from __future__ import annotations

import threading
from collections.abc import Collection, Sequence

import numpy as np
import rospy
from gazebo_msgs.msg import ModelState
from gazebo_msgs.srv import SetModelConfiguration, SetModelState

from g1_description.bridge.sender import FAILURES
from g1_description.motion.playlist import Setpoint
from g1_description.ros.conversions import pose_from_array
from g1_description.ros.log import SHORT_PERIOD, ThrottledLog

CALL_TIMEOUT = 1.0
"""Longest wait for the end of a call, in [s] of wall time."""

RETRY_PERIOD = 0.2
"""Wait before a failed call is tried again, in [s] of wall time."""


class GazeboWriter:
    """Sets base and joints by two calls, one after the other; the newest sample wins.

    Calls: <gazebo>/set_model_state (gazebo_msgs/SetModelState),
        <gazebo>/set_model_configuration (gazebo_msgs/SetModelConfiguration)
    """

    def __init__(self, gazebo: str, model: str, log: ThrottledLog) -> None:
        """Prepare; the thread begins with the first sample.

        Args:
            gazebo: Namespace of the simulator.
            model: Name of the robot in the simulated world.
            log: Where to log what went wrong.
        """
        self._gazebo, self._model, self._log = gazebo, model, log
        self._changed = threading.Condition()
        self._positions: dict[str, float] = {}
        self._base: np.ndarray | None = None
        self._is_calling = False
        self._thread: threading.Thread | None = None
        self._stopped = threading.Event()

    def put(self, joints: Sequence[str], wanted: Setpoint) -> None:
        """Send a sample as soon as the present call is over.

        Args:
            joints: Names of the robot's movable joints.
            wanted: The sample.
        """
        names = [joints[row] for row in wanted.rows]
        with self._changed:
            self._positions.update(zip(names, wanted.positions.tolist()))
            if wanted.base_pose is not None:
                self._base = wanted.base_pose
            self._changed.notify_all()
            if self._thread is None:
                self._begin()

    def release(self, joints: Collection[str], base: bool) -> None:
        """Leave joints, and perhaps the base, to another command.

        The call under way ends first, so that it does not come after that command.
        """
        with self._changed:
            self._changed.wait_for(lambda: not self._is_calling, CALL_TIMEOUT)
            for name in joints:
                self._positions.pop(name, None)
            if base:
                self._base = None

    def _begin(self) -> None:
        """Connect, and begin to send."""
        gazebo = self._gazebo
        self._set_base = rospy.ServiceProxy(
            f"{gazebo}/set_model_state", SetModelState, persistent=True
        )
        self._set_joints = rospy.ServiceProxy(
            f"{gazebo}/set_model_configuration", SetModelConfiguration, persistent=True
        )
        rospy.on_shutdown(self._stop)
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def _stop(self) -> None:
        """End the thread."""
        self._stopped.set()
        with self._changed:
            self._changed.notify_all()

    def _run(self) -> None:
        """Send samples until the node is shut down."""
        while not self._stopped.is_set():
            with self._changed:
                while not (self._positions or self._base is not None):
                    if self._stopped.is_set():
                        return
                    self._changed.wait()
                positions, self._positions = self._positions, {}
                base, self._base = self._base, None
                self._is_calling = True
            self._try(base, positions)

    def _try(self, base: np.ndarray | None, positions: dict[str, float]) -> None:
        """Send a sample; keep it where that fails."""
        failure: Exception | None = None
        try:
            self._send(base, positions)
        # rospy raises AttributeError where it closes the connection meanwhile.
        except (*FAILURES, AttributeError) as error:
            failure = error
        with self._changed:
            if failure and not self._stopped.is_set():
                self._positions = {**positions, **self._positions}
                self._base = base if self._base is None else self._base
            self._is_calling = False
            self._changed.notify_all()
        if failure and not self._stopped.is_set():
            self._reconnect(failure)

    def _send(self, base: np.ndarray | None, positions: dict[str, float]) -> None:
        """Set the base, then the joints."""
        if base is not None:
            state = ModelState(model_name=self._model, pose=pose_from_array(base))
            self._check(self._set_base(state))
        if positions:
            names, values = list(positions), list(positions.values())
            self._check(self._set_joints(self._model, "", names, values))

    def _check(self, answer) -> None:
        """Log why the simulator refused a sample, if it did."""
        if not answer.success:
            text = f"The simulator refused a sample of a motion of {self._model}"
            text = f"{text}: {answer.status_message}"
            self._log.warn(f"sample {self._model}", text, SHORT_PERIOD)

    def _reconnect(self, failure: Exception) -> None:
        """Log why a sample did not arrive, and connect anew after a while."""
        self._log.warn("service", f"A motion waits for the simulator: {failure}.")
        self._set_base.close()
        self._set_joints.close()
        self._stopped.wait(RETRY_PERIOD)
