"""Joint commands to the simulator: checked, merged, sent, and sent again on failure.

The services of gazebo_ros answer with sentences. So unknown joints and positions beyond
the limits are found here, from the robot's description.
"""

from __future__ import annotations

import itertools
import math
import threading
import time
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence

import numpy as np
import rospy
from gazebo_msgs.msg import ModelState
from gazebo_msgs.srv import SetModelConfiguration, SetModelState
from sensor_msgs.msg import JointState

from g1_description.robot.description import Joint, clamped_to_limits
from g1_description.ros.conversions import pose_from_array
from g1_description.ros.log import SHORT_PERIOD, ThrottledLog
from g1_description.ros.waiting import SERVICE_ERRORS
from g1_description.text import did_you_mean, listed

MAX_NAMES = 50
"""Ignored names that are counted one by one: names come from outside."""

OTHERS = "(other names)"


class CommandTally:
    """Checks the commands of one robot, and counts clamped and ignored positions."""

    def __init__(self, joints: Iterable[Joint]) -> None:
        self._joints = {joint.name: joint for joint in joints}
        self.received = 0
        """Commands with at least one valid position."""
        self.answered = 0
        """How many of them the simulator has answered, alone or merged with others."""
        self.sent = 0
        """Requests that the simulator answered with success."""
        self.refused = 0
        """Requests that it refused."""
        self.reason = ""
        """Why it refused the last request; empty if it did not."""
        self.waiting_since: float | None = None
        """Since when a request waits for its answer, on the monotonic clock."""
        self.clamped: Counter[str] = Counter()
        """Positions beyond the limits, by joint."""
        self.ignored: Counter[str] = Counter()
        """Ignored positions, by the name in the command: unknown, given again, without
        a position, or with one that is not finite; '' for positions without a name."""
        self.last_ignored: tuple[float, str] | None = None
        """When part of a command was last ignored, on the monotonic clock, and why."""
        self._last_clamped: dict[str, float] = {}

    def take(
        self, names: Sequence[str], positions: Sequence[float], now: float
    ) -> tuple[dict[str, float], str, str]:
        """Split a command into valid and ignored positions.

        Args:
            names: Joint names in the command.
            positions: Positions in [rad] or [m] in the command.
            now: Time of the command in [s] on the monotonic clock.

        Returns:
            The valid positions by joint name, where the last of equal names wins; why
            the rest is ignored; and which will be clamped. The last two are parts of a
            sentence, or empty.
        """
        accepted: dict[str, float] = {}
        clamped: dict[str, tuple[float, float]] = {}
        unknown, not_finite = [], []
        for name, position in itertools.zip_longest(names, positions):
            joint = self._joints.get(name)
            if joint and position is not None and math.isfinite(position):
                if name in accepted:
                    self.ignored[name] += 1
                accepted[name] = float(position)
                limit = min(max(position, joint.lower), joint.upper)
                if limit != position:
                    clamped[name] = position, limit
                    self.clamped[name] += 1
                    self._last_clamped[name] = now
                continue
            known = name in self.ignored or len(self.ignored) < MAX_NAMES
            self.ignored[(name or "") if known else OTHERS] += 1
            if name is None or position is None:
                continue  # reported by _unpaired
            if joint:
                not_finite.append(f"{name} = {position}")
            else:
                unknown.append(name)
        problems = [
            *_unpaired(names, positions),
            unknown
            and f"unknown joint {listed(unknown)}"
            + did_you_mean(unknown[0], self._joints),
            not_finite and f"positions must be finite: {listed(not_finite)}",
        ]
        ignored = "; ".join(filter(None, problems))
        if ignored:
            self.last_ignored = now, ignored
        return accepted, ignored, clamped_to_limits(clamped, self._joints.values())

    def clamped_since(self, time: float) -> list[str]:
        """Return the joints that were clamped after a time in [s]."""
        # A copy: another thread counts meanwhile.
        last = self._last_clamped.copy()
        return [name for name, when in last.items() if when > time]

    @property
    def is_empty(self) -> bool:
        """Whether no position was clamped or ignored so far."""
        return not (self.clamped or self.ignored)

    @property
    def waiting(self) -> float:
        """How long a request has been waiting for the simulator's answer, in [s]."""
        since = self.waiting_since
        return 0.0 if since is None else time.monotonic() - since


def _unpaired(names: Sequence[str], positions: Sequence[float]) -> Iterator[str]:
    """Describe the names and positions of a command that do not pair up."""
    if not names:
        yield "it has no joint names"
    elif len(names) > len(positions):
        yield f"no position for {listed(names[len(positions) :])}"
    elif len(positions) > len(names):
        plural = "s" if len(names) > 1 else ""
        yield f"{len(positions)} positions for {len(names)} name{plural}"
    repeated = [name for name, count in Counter(names).items() if count > 1]
    if repeated:
        yield f"{listed(repeated)} more than once, where the last position applies"


RETRY_PERIOD = 0.2
"""Wait before a failed request is sent again, in [s] of wall time."""

CALL_TIMEOUT = 1.0
"""Longest wait for the end of a request under way, in [s] of wall time."""


class JointCommands:
    """Sends one robot's commands to the simulator, one request at a time.

    Commands that arrive during a request are merged joint by joint; the newest position
    of each wins. The positions of a failed request are sent again, unless newer ones
    have arrived. Samples of motions that the bridge plays are sent here, too.

    Subscribes: joint_commands (sensor_msgs/JointState)
    Calls: <gazebo>/set_model_configuration (gazebo_msgs/SetModelConfiguration),
        <gazebo>/set_model_state (gazebo_msgs/SetModelState)
    """

    def __init__(
        self, gazebo: str, model: str, tally: CommandTally, log: ThrottledLog
    ) -> None:
        self._gazebo, self._model = gazebo, model
        self._tally, self._log = tally, log
        self._connect()
        # rospy has a thread for each publisher of commands.
        self._changed = threading.Condition()
        self._positions: dict[str, float] = {}
        self._base: np.ndarray | None = None
        self._is_calling = False
        self._thread: threading.Thread | None = None
        self._stopped = threading.Event()

    def _connect(self) -> None:
        """Create proxies; rospy's cannot be reused after an error."""
        self._set_base = rospy.ServiceProxy(
            f"{self._gazebo}/set_model_state", SetModelState, persistent=True
        )
        self._set_joints = rospy.ServiceProxy(
            f"{self._gazebo}/set_model_configuration",
            SetModelConfiguration,
            persistent=True,
        )

    def subscribe(
        self,
        topic: str,
        note: Callable[[Mapping[str, float]], None],
        record: Callable[[JointState, Mapping[str, float], str], None],
    ) -> None:
        """Take commands from a topic.

        Args:
            topic: Its name.
            note: Called with the valid positions by joint name before they are sent.
            record: Called with each message, its valid positions, and why the rest is
                ignored or empty.
        """
        self._note, self._record = note, record
        # Messages may name different joints, so none of them may be lost.
        rospy.Subscriber(
            topic, JointState, self._on_command, queue_size=None, tcp_nodelay=True
        )

    def _on_command(self, message: JointState) -> None:
        """Queue a command, and log ignored and clamped positions."""
        with self._changed:
            now = time.monotonic()
            accepted, ignored, clamped = self._tally.take(
                message.name, message.position, now
            )
        self._record(message, accepted, ignored)
        if ignored:
            subject = "Part of a joint command" if accepted else "A joint command"
            text = f"{subject} to {self._model} is ignored: {ignored}."
            self._log.warn(f"command {self._model}", text, SHORT_PERIOD)
        if clamped:
            text = f"A joint command to {self._model} is {clamped}."
            self._log.warn(f"clamped {self._model}", text, SHORT_PERIOD)
        if accepted:
            self._note(accepted)
            with self._changed:
                self._tally.received += 1
                self.put(accepted)

    def put(
        self, positions: Mapping[str, float], base: np.ndarray | None = None
    ) -> None:
        """Queue a request, to be sent when the current one is answered.

        Args:
            positions: Finite positions in [rad] or [m] by joint name.
            base: Pose of the root link in the world, shape (7,); None: it stays.
        """
        with self._changed:
            if self._tally.waiting_since is None:
                self._tally.waiting_since = time.monotonic()
            self._positions.update(positions)
            self._base = self._base if base is None else base
            self._changed.notify_all()
            if self._thread is None:
                rospy.on_shutdown(self._stop)
                self._thread = threading.Thread(target=self._run, daemon=True)
                self._thread.start()

    def release(self, joints: Collection[str], base: bool) -> None:
        """Drop queued positions of joints, and optionally the base.

        Waits for the current request, so that it cannot overtake a later command.
        """
        with self._changed:
            self._changed.wait_for(lambda: not self._is_calling, CALL_TIMEOUT)
            self.drop(joints, base)

    def drop(self, joints: Collection[str], base: bool) -> None:
        """Drop queued positions like ``release``, without waiting."""
        with self._changed:
            for name in joints:
                self._positions.pop(name, None)
            if base:
                self._base = None
            if not self._is_pending:
                self._tally.answered = self._tally.received

    @property
    def _is_pending(self) -> bool:
        """Whether a request is queued."""
        return bool(self._positions) or self._base is not None

    def _stop(self) -> None:
        """End the thread."""
        self._stopped.set()
        with self._changed:
            self._changed.notify_all()

    def _run(self) -> None:
        """Send requests until the node is shut down."""
        while True:
            with self._changed:
                if not self._is_pending:
                    self._tally.waiting_since = None
                self._changed.wait_for(
                    lambda: self._is_pending or self._stopped.is_set()
                )
                if self._stopped.is_set():
                    return
                positions, self._positions = self._positions, {}
                base, self._base = self._base, None
                received, self._is_calling = self._tally.received, True
            error = self._send(positions, base)
            with self._changed:
                if error is None:
                    self._tally.answered = received
                    self._tally.waiting_since = time.monotonic()
                else:
                    self._positions = {**positions, **self._positions}
                    self._base = base if self._base is None else self._base
                self._is_calling = False
                self._changed.notify_all()
            if error is not None and not self._stopped.is_set():
                self._reconnect(error)

    def _send(
        self, positions: Mapping[str, float], base: np.ndarray | None
    ) -> Exception | None:
        """Set the base, then the joints; return the error if there is no answer."""
        answers = []
        names, values = list(positions), list(positions.values())
        try:
            if base is not None:
                state = ModelState(model_name=self._model, pose=pose_from_array(base))
                answers.append(self._set_base(state))
            if positions:
                answers.append(self._set_joints(self._model, "", names, values))
        # rospy raises AttributeError if it closes the connection meanwhile.
        except (*SERVICE_ERRORS, AttributeError) as error:
            return error
        reasons = [one.status_message for one in answers if not one.success]
        tally = self._tally
        tally.reason = "; ".join(reasons)
        if not reasons:
            tally.sent += 1
            return None
        tally.refused += 1
        refused = listed([*names, *(["the base"] if base is not None else ())])
        text = f"The simulator refused a command to {self._model} for {refused}"
        self._log.warn(
            f"refused {self._model}", f"{text}: {tally.reason}", SHORT_PERIOD
        )
        return None

    def _reconnect(self, error: Exception) -> None:
        """Log the error, and connect again after a while."""
        text = f"Cannot send a command to the simulator, retrying: {error}."
        self._log.warn("service", text)
        self._set_base.close()
        self._set_joints.close()
        self._connect()
        self._stopped.wait(RETRY_PERIOD)
