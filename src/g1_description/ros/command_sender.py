"""Joint commands on their way to the simulator: merged, sent, never lost."""

from __future__ import annotations

import threading
from collections.abc import Mapping

import rospy
from gazebo_msgs.srv import SetModelConfiguration

SUCCESS = "SetModelConfiguration: success"
# A connection that breaks while it is written to raises outside rospy's family.
FAILURES = (
    rospy.ServiceException,
    rospy.ROSException,
    rospy.exceptions.ROSInternalException,
    OSError,
)
RETRY = 0.2
"""Wait before a failed call is tried again, in [s] of wall time."""


class CommandSender:
    """One thread and one connection between commands and the service.

    Commands that come while a call is under way add up per joint; the newest
    position of each wins. A call that fails goes back under what came since.
    """

    def __init__(self, service: str, model_name: str, robot_description: str) -> None:
        """Prepare; nothing is sent before ``start``.

        Args:
            service: Name of the simulator's set_model_configuration.
            model_name: The robot in the simulated world.
            robot_description: The parameter the request names; Gazebo ignores it.
        """
        self._service = service
        self._model_name = model_name
        self._robot_description = robot_description
        self._pending: dict[str, float] = {}
        self._changed = threading.Condition()
        self._stopped = threading.Event()
        self._proxy = None
        self._thread = threading.Thread(target=self._run, name="commands", daemon=True)

    def start(self) -> None:
        """Begin to send."""
        rospy.on_shutdown(self._stop)
        self._thread.start()

    def put(self, positions: Mapping[str, float]) -> None:
        """Take a command; it is sent as soon as the call under way is over.

        Args:
            positions: Finite positions in [rad] or [m] by joint name.
        """
        with self._changed:
            self._pending.update(positions)
            self._changed.notify()

    def _stop(self) -> None:
        """Let the thread end."""
        self._stopped.set()
        with self._changed:
            self._changed.notify()

    def _take(self) -> dict[str, float]:
        """Wait for commands and take all there are."""
        with self._changed:
            while not self._pending and not self._stopped.is_set():
                self._changed.wait()
            taken, self._pending = self._pending, {}
            return taken

    def _run(self) -> None:
        """Send what comes until the node is shut down."""
        while not self._stopped.is_set():
            positions = self._take()
            if positions and not self._stopped.is_set():
                self._send(positions)

    def _send(self, positions: dict[str, float]) -> None:
        """Call the service once; on failure put the command back."""
        if self._proxy is None:
            self._proxy = rospy.ServiceProxy(
                self._service, SetModelConfiguration, persistent=True
            )
        try:
            response = self._proxy(
                self._model_name,
                self._robot_description,
                list(positions),
                list(positions.values()),
            )
        except FAILURES as error:
            self._put_back(positions, error)
            return
        if not response.success:
            rospy.logerr_throttle_identical(
                1.0,
                f"The simulator refused a command for {', '.join(positions)}: "
                f"{response.status_message}",
            )
        elif response.status_message != SUCCESS:
            rospy.logwarn_throttle_identical(
                1.0, f"The simulator answered a command: {response.status_message}."
            )

    def _put_back(self, positions: dict[str, float], error: Exception) -> None:
        """Keep a command that did not arrive for the next try."""
        if self._stopped.is_set():
            return
        rospy.logwarn_throttle_identical(
            10.0, f"A command waits for the simulator: {error}"
        )
        self._proxy.close()
        self._proxy = None
        with self._changed:
            self._pending = {**positions, **self._pending}
        self._stopped.wait(RETRY)
