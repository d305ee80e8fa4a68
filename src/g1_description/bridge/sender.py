"""Joint commands on their way to the simulator: merged, sent, never lost."""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable, Collection, Mapping, Sequence

import rosgraph
import rospy
from gazebo_msgs.srv import SetModelConfiguration, SetModelConfigurationResponse
from sensor_msgs.msg import JointState

from g1_description.bridge.status import CommandCount, RobotStatus
from g1_description.ros import master
from g1_description.ros.log import SHORT_PERIOD, ThrottledLog
from g1_description.text import listed


def split_command(
    names: Sequence[str], positions: Sequence[float], joints: Collection[str]
) -> tuple[dict[str, float], list[str]]:
    """Split a command into positions that can be obeyed and problems.

    Args:
        names: Joint names in the command.
        positions: Positions in [rad] or [m] in the command.
        joints: Names of the joints that exist and move.

    Returns:
        The positions to set by joint name, where the last of equal names wins, and a
        part of a sentence for each problem with the rest.
    """
    pairs = list(zip(names, positions))
    unknown = [name for name, _ in pairs if name not in joints]
    not_finite = [
        f"{name} = {position}"
        for name, position in pairs
        if name in joints and not math.isfinite(position)
    ]
    problems = []
    if not names:
        problems.append("it names no joint")
    if len(names) > len(positions):
        problems.append(f"no position for {listed(names[len(positions) :])}")
    if len(positions) > len(names):
        problems.append(
            f"{len(positions)} positions for {len(names)} names, the rest is ignored"
        )
    if unknown:
        problems.append(f"no movable joint is called {listed(unknown)}")
    if not_finite:
        problems.append(f"not a finite position: {listed(not_finite)}")
    accepted = {
        name: float(position)
        for name, position in pairs
        if name in joints and math.isfinite(position)
    }
    return accepted, problems


SUCCESS = "SetModelConfiguration: success"
# A connection or a master that breaks in the middle raises outside rospy's family.
FAILURES = (
    rospy.ServiceException,
    rospy.ROSException,
    rospy.exceptions.ROSInternalException,
    rosgraph.MasterException,
    *master.SLAVE_API_ERRORS,
)
RETRY_PERIOD = 0.2
"""Wait before a failed call is tried again, in [s] of wall time."""


class CommandListener:
    """Subscribes to one robot's joint commands and hands on what can be obeyed."""

    def __init__(
        self,
        topic: str,
        status: RobotStatus,
        sender: CommandSender,
        log: ThrottledLog,
        note: Callable[[Mapping[str, float]], None],
    ) -> None:
        """Subscribe.

        Args:
            topic: Name of the topic.
            status: The robot.
            sender: Sends the commands.
            log: Where to log what cannot be obeyed.
            note: Called with the positions that can be obeyed, by joint name, before
                they are sent.
        """
        self._status, self._sender, self._log = status, sender, log
        self._note = note
        joints = status.description.movable_joints
        self._movable = frozenset(joint.name for joint in joints)
        # rospy has a thread for each publisher of commands.
        self._lock = threading.Lock()
        # Messages may name different joints, so none of them may be lost.
        rospy.Subscriber(
            topic, JointState, self.on_command, queue_size=None, tcp_nodelay=True
        )

    def on_command(self, message: JointState) -> None:
        """Hand on a command, and log what of it is ignored."""
        status, names, positions = self._status, message.name, message.position
        with self._lock:
            status.tally.count(names, positions, time.monotonic())
        accepted, problems = split_command(names, positions, self._movable)
        if problems:
            status.ignored = time.monotonic(), "; ".join(problems)
            text = f"Part of a joint command to {status.name} is ignored"
            self._log.warn(
                f"command {status.name}", f"{text}: {status.ignored[1]}.", SHORT_PERIOD
            )
        if accepted:
            self._note(accepted)
            self._sender.put(status.name, accepted)


class CommandSender:
    """Sends the commands of all robots from one thread over one connection.

    Commands that arrive during a call are merged joint by joint; the newest position
    of each wins. After a call that failed its positions are sent again, unless newer
    ones have arrived.
    """

    def __init__(
        self,
        service: str,
        descriptions: Mapping[str, str],
        counts: Mapping[str, CommandCount],
        log: ThrottledLog,
    ) -> None:
        """Prepare; nothing is sent before ``start``.

        Args:
            service: Name of the simulator's set_model_configuration.
            descriptions: The parameter that a request names, by model; Gazebo
                ignores it.
            counts: Where to count each model's commands.
            log: Where to log what went wrong.
        """
        self._service = service
        self._descriptions = descriptions
        self._log = log
        self.counts = counts
        """What became of the commands, by model."""
        self._pending: dict[str, dict[str, float]] = {}
        self._changed = threading.Condition()
        self._stopped = threading.Event()
        self._proxy = None
        self._waiting_since: float | None = None
        self._thread = threading.Thread(target=self._run, name="commands", daemon=True)

    def start(self) -> None:
        """Start to send."""
        rospy.on_shutdown(self._stop)
        self._thread.start()

    def put(self, model: str, positions: Mapping[str, float]) -> None:
        """Queue a command; it is sent as soon as the present call is over.

        Args:
            model: The robot in the simulated world.
            positions: Finite positions in [rad] or [m] by joint name.
        """
        with self._changed:
            if self._waiting_since is None:
                self._waiting_since = time.monotonic()
            self._pending.setdefault(model, {}).update(positions)
            self.counts[model].received += 1
            self._changed.notify()

    @property
    def waiting(self) -> float:
        """How long a command has been waiting for the simulator's answer, in [s]."""
        since = self._waiting_since
        return 0.0 if since is None else time.monotonic() - since

    def _stop(self) -> None:
        """End the thread."""
        self._stopped.set()
        with self._changed:
            self._changed.notify()

    def _take(self) -> list[tuple[str, dict[str, float], int]]:
        """Wait for commands; return all: model, positions, how many were received."""
        with self._changed:
            while not self._pending and not self._stopped.is_set():
                self._waiting_since = None
                self._changed.wait()
            taken, self._pending = self._pending, {}
            return [(m, taken[m], self.counts[m].received) for m in taken]

    def _run(self) -> None:
        """Send commands until the node is shut down."""
        while not self._stopped.is_set():
            for model, positions, received in self._take():
                if not self._stopped.is_set():
                    self._send(model, positions, received)

    def _send(self, model: str, positions: dict[str, float], received: int) -> None:
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
        self.counts[model].answered = received
        self._note_answer(model, names, answer)

    def _note_answer(
        self, model: str, names: list[str], answer: SetModelConfigurationResponse
    ) -> None:
        """Count an answer, and log what it says against the command."""
        count, message = self.counts[model], answer.status_message
        if answer.success:
            count.sent += 1
            count.reason = ""
        else:
            count.refused += 1
            count.reason = message
            text = f"The simulator refused a command to {model} for {', '.join(names)}"
            self._log.warn(f"refused {model}", f"{text}: {message}", SHORT_PERIOD)
        if answer.success and message != SUCCESS:
            text = f"The simulator answered a command to {model}: {message}."
            self._log.warn(f"answered {model}", text, SHORT_PERIOD)

    def _put_back(
        self, model: str, positions: dict[str, float], error: Exception
    ) -> None:
        """Put a command that did not arrive back into the queue."""
        if self._stopped.is_set():
            return
        self._log.warn("service", f"A command waits for the simulator: {error}.")
        self._proxy.close()
        self._proxy = None
        with self._changed:
            since = self._pending.get(model, {})
            self._pending[model] = {**positions, **since}
        self._stopped.wait(RETRY_PERIOD)
