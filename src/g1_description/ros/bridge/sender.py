"""Joint commands on their way to the simulator: merged, sent, never lost."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass

import rosgraph
import rospy
from gazebo_msgs.srv import SetModelConfiguration

from g1_description.ros.node import own_node

SUCCESS = "SetModelConfiguration: success"
# A connection or a master that breaks in the middle raises outside rospy's family.
FAILURES = (
    rospy.ServiceException,
    rospy.ROSException,
    rospy.exceptions.ROSInternalException,
    rosgraph.MasterException,
    *own_node.FAILURES,
)
RETRY = 0.2
"""Wait before a failed call is tried again, in [s] of wall time."""


@dataclass
class CommandCount:
    """What became of one robot's commands."""

    came: int = 0
    """Commands that have come."""

    answered: int = 0
    """How many of them the simulator has answered, alone or merged with others."""

    sent: int = 0
    """Calls that the simulator answered with success."""

    refused: int = 0
    """Calls that it refused."""

    reason: str = ""
    """Why it refused the last call; empty if it did not."""


class CommandSender:
    """One thread and one connection between all robots' commands and the service.

    Commands that come while a call is under way add up per joint; the newest
    position of each wins. A call that fails goes back under what came since.
    """

    def __init__(
        self, service: str, descriptions: Mapping[str, str], complain: Callable
    ) -> None:
        """Prepare; nothing is sent before ``start``.

        Args:
            service: Name of the simulator's set_model_configuration.
            descriptions: The parameter that a request names, by model; Gazebo
                ignores it.
            complain: Tells what went wrong, as ``Complaints.tell``.
        """
        self._service = service
        self._descriptions = descriptions
        self._complain = complain
        self.counts = {model: CommandCount() for model in descriptions}
        self._pending: dict[str, dict[str, float]] = {}
        self._changed = threading.Condition()
        self._stopped = threading.Event()
        self._proxy = None
        self._waiting_since: float | None = None
        self._thread = threading.Thread(target=self._run, name="commands", daemon=True)

    def start(self) -> None:
        """Begin to send."""
        rospy.on_shutdown(self._stop)
        self._thread.start()

    def put(self, model: str, positions: Mapping[str, float]) -> None:
        """Take a command; it is sent as soon as the call under way is over.

        Args:
            model: The robot in the simulated world.
            positions: Finite positions in [rad] or [m] by joint name.
        """
        with self._changed:
            if self._waiting_since is None:
                self._waiting_since = time.monotonic()
            self._pending.setdefault(model, {}).update(positions)
            self.counts[model].came += 1
            self._changed.notify()

    @property
    def waiting(self) -> float:
        """How long a command has been waiting for the simulator's answer, in [s]."""
        since = self._waiting_since
        return 0.0 if since is None else time.monotonic() - since

    def _stop(self) -> None:
        """Let the thread end."""
        self._stopped.set()
        with self._changed:
            self._changed.notify()

    def _take(self) -> list[tuple[str, dict[str, float], int]]:
        """Wait for commands and take all there are: model, positions, how many came."""
        with self._changed:
            while not self._pending and not self._stopped.is_set():
                self._waiting_since = None
                self._changed.wait()
            taken, self._pending = self._pending, {}
            return [(m, taken[m], self.counts[m].came) for m in taken]

    def _run(self) -> None:
        """Send what comes until the node is shut down."""
        while not self._stopped.is_set():
            for model, positions, came in self._take():
                if not self._stopped.is_set():
                    self._send(model, positions, came)

    def _send(self, model: str, positions: dict[str, float], came: int) -> None:
        """Call the service once; on failure put the command back."""
        if self._proxy is None:
            self._proxy = rospy.ServiceProxy(
                self._service, SetModelConfiguration, persistent=True
            )
        names, values = list(positions), list(positions.values())
        try:
            answer = self._proxy(model, self._descriptions[model], names, values)
        except FAILURES as error:
            self._put_back(model, positions, error)
            return
        self._waiting_since = time.monotonic()
        count, words = self.counts[model], answer.status_message
        count.answered = came
        if answer.success:
            count.sent += 1
            count.reason = ""
        else:
            count.refused += 1
            count.reason = words
            told = f"The simulator refused a command to {model} for {', '.join(names)}"
            self._complain(f"refused {model}", f"{told}: {words}", 1.0)
        if answer.success and words != SUCCESS:
            told = f"The simulator answered a command to {model}: {words}."
            self._complain(f"answered {model}", told, 1.0)

    def _put_back(
        self, model: str, positions: dict[str, float], error: Exception
    ) -> None:
        """Keep a command that did not arrive for the next try."""
        if self._stopped.is_set():
            return
        self._complain("service", f"A command waits for the simulator: {error}.")
        self._proxy.close()
        self._proxy = None
        with self._changed:
            since = self._pending.get(model, {})
            self._pending[model] = {**positions, **since}
        self._stopped.wait(RETRY)
