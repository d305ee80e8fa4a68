"""A running robot as seen by other nodes: its description, state and motions."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager

import rosgraph
import rospy

from g1_description.errors import InvalidValueError
from g1_description.robot.assembly import WORLD, base_of
from g1_description.robot.description import Description
from g1_description.robot.state import RobotState
from g1_description.ros.log import ThrottledLog
from g1_description.ros.parameters import DESCRIPTION, read_robot, wait_for_parameter
from g1_description.ros.playing import MotionClient, set_anchor
from g1_description.ros.robot_states import RobotStates
from g1_description.ros.waiting import NoAnswerError, wait_until
from g1_description.srv import PlayMotion, SetAnchor

MAP = "map"

DESCRIPTION_TIMEOUT = 10.0
"""Longest wait for a description, in [s]: the launch may have just started."""

PERIOD = 0.01
"""Longest delay before messages are read, in [s]."""

QUIET = 2.0
"""Time without states or newer stamps after which a wait reports it, in [s]."""

GONE = 5.0
"""Time without a publisher after which a robot is gone, in [s]: roslaunch respawns a
bridge."""

STANDS_STILL = "simulated time stands still"


class RobotView:
    """Follows one robot.

    Subscribes: robot_state, or joint_states and TF, as ``RobotStates`` does.
    Calls: play_motion (g1_description/PlayMotion), set_anchor
        (g1_description/SetAnchor)
    Reads: robot_description, searched for upward from the robot's namespace.
    """

    def __init__(self, namespace: str, notify: Callable[[str], None]) -> None:
        """Read the description and subscribe.

        Args:
            namespace: Namespace of the robot's topics, without outer slashes; empty:
                the node's. It is also the prefix of the robot's frames.
            notify: Called with messages about the reason of a wait.

        Raises:
            DescriptionError: If the description is invalid.
            NoAnswerError: If there is no description or no master.
            ROSInterruptException: If the node is shut down.
        """
        try:
            self.description = wait_for_description(namespace, notify)
            self._prefix = f"/{namespace}/" if namespace else ""
            self.topic = rospy.resolve_name(f"{self._prefix}joint_states")
            base, _ = base_of(self.description)
            frame = MAP if base == WORLD else self._prefix.lstrip("/") + base
            self._states = RobotStates(MAP, frame, PERIOD, ThrottledLog(), self.topic)
        except (OSError, rosgraph.MasterException) as error:
            raise NoAnswerError(f"The ROS master does not answer: {error}.") from error
        service = rospy.ServiceProxy(f"{self._prefix}play_motion", PlayMotion)
        self.motions = MotionClient(service)
        self._set_anchor = rospy.ServiceProxy(f"{self._prefix}set_anchor", SetAnchor)
        self._anchor_before: str | None = None
        self._units = {
            joint.name: "m" if joint.kind == "prismatic" else "rad"
            for joint in self.description.movable_joints
        }
        self._notify = notify
        self._state: RobotState | None = None
        self._positions: dict[str, float] = {}
        self._heard = self._advanced = 0.0
        """Arrival of the last state, and of the last with a new stamp: monotonic."""
        self._stamp = 0
        self._reported = self._refused = ""
        self._alone: float | None = None
        """When its state was first found unpublished, on the monotonic clock."""

    def _poll(self) -> None:
        """Read the newest state, if there is one."""
        try:
            state = self._states.newest()
        except InvalidValueError as error:
            if str(error) != self._refused:
                self._refused = str(error)
                self._notify(self._refused)
            return
        if state is None:
            return
        self._state, self._heard = state, time.monotonic()
        if state.stamp != self._stamp:
            self._stamp, self._advanced = state.stamp, self._heard
        for name, position in state.positions_by_name.items():
            if name in self._units and math.isfinite(position):
                self._positions[name] = position

    @property
    def state(self) -> RobotState | None:
        """The newest state; None before the first."""
        self._poll()
        return self._state

    @property
    def now_ns(self) -> int:
        """Time of its newest state, in [ns]."""
        state = self.state
        return state.stamp if state else 0

    @property
    def positions(self) -> dict[str, float]:
        """Last finite positions in [rad] or [m] of the movable joints, by name."""
        self._poll()
        return self._positions.copy()

    @property
    def missing(self) -> list[str]:
        """Names of the movable joints without a known position."""
        known = self.positions
        joints = self.description.movable_joints
        return [joint.name for joint in joints if joint.name not in known]

    @property
    def no_base(self) -> str:
        """Why a state has no base."""
        return self._states.no_base

    def away(self, goal: Mapping[str, float], tolerance: float) -> list[str]:
        """Describe the joints that are not at a goal.

        Args:
            goal: Positions in [rad] or [m] by joint name.
            tolerance: Largest allowed deviation, in [rad] or [m].
        """
        state = self.state
        shown = state.positions_by_name if state else {}
        return [
            f"{name} at {shown[name]:g} instead of {position:g} {self._units[name]}"
            if name in shown
            else f"no {name}"
            for name, position in goal.items()
            if not abs(shown.get(name, math.inf) - position) <= tolerance
        ]

    def forget_newest(self) -> None:
        """Use only states that arrive from now on."""
        self._poll()
        self._state = None

    def wait_until(self, condition: Callable, timeout: float | None):
        """Wait until a condition on the states holds; report obstacles.

        Returns:
            The last result of the condition.

        Raises:
            ROSInterruptException: If the node is shut down.
        """
        begin, self._reported = time.monotonic(), ""

        def holds():
            result = condition()
            if not result:
                self._report(self.obstacle(begin))
            return result

        return wait_until(holds, timeout)

    def _report(self, obstacle: str) -> None:
        """Report an obstacle, once."""
        if obstacle not in ("", self._reported):
            self._notify(f"waiting: {obstacle}")
        self._reported = obstacle or self._reported

    def look_after_time(self) -> None:
        """Report why its time stands still, if it does; to be called periodically.

        Raises:
            NoAnswerError: If its state is no longer published.
        """
        obstacle = self.obstacle()
        self._report(obstacle)
        self._reported = obstacle
        if self._states.is_published:
            self._alone = None
            return
        now = time.monotonic()
        self._alone = self._alone or now
        if now > self._alone + GONE:
            raise NoAnswerError(
                f"{self.topic} has no publisher any more; has the bridge ended?"
            )

    def obstacle(self, begin: float = 0.0) -> str:
        """Return why a wait does not end; empty if no reason is known.

        Args:
            begin: Start of the wait, on the monotonic clock.
        """
        self._poll()
        if max(begin, self._heard) < time.monotonic() - QUIET:
            return self.silence
        if max(begin, self._advanced) < time.monotonic() - QUIET:
            return f"{STANDS_STILL} at {1e-9 * self._stamp:g} s."
        return ""

    @property
    def stands_still(self) -> bool:
        """Whether stamps have not changed for a while."""
        return time.monotonic() - self._advanced > QUIET

    @property
    def silence(self) -> str:
        """A message that there are no states, with a possible cause."""
        if self._heard:
            last = 1e-9 * self._stamp
            return f"no messages on {self.topic} after {last:g} s; is time paused?"
        return f"no messages on {self.topic}; is a simulator running and unpaused?"

    @contextmanager
    def anchored(self, link: str | None) -> Iterator[None]:
        """Keep a link at its place while joints move meanwhile.

        Args:
            link: A link, or ``lowest_foot``; empty: none; None: as before.

        Raises:
            RefusedError: If there is no such link, or physics is not ``kinematic``.
            NoAnswerError: If the bridge does not answer.
        """
        if link is not None:
            self._anchor_before = set_anchor(self._set_anchor, link)
        try:
            yield
        finally:
            self.restore_anchor()

    def restore_anchor(self) -> None:
        """Set the anchor as it was before ``anchored``, also before a shutdown.

        Raises:
            G1DescriptionError: If the bridge does not answer.
        """
        before, self._anchor_before = self._anchor_before, None
        if before is not None:
            set_anchor(self._set_anchor, before)

    def close(self) -> None:
        """Unsubscribe."""
        self._states.close()


def wait_for_description(namespace: str, notify: Callable[[str], None]) -> Description:
    """Wait until a robot is on the parameter server, and parse it.

    Args:
        namespace: Namespace of the robot's topics, without outer slashes.
        notify: Called with messages about the reason of the wait.

    Raises:
        NoAnswerError: If there is no description.
        DescriptionError: If it is invalid.
        ROSInterruptException: If the node is shut down.
    """
    place = f"parameter {DESCRIPTION} in /{namespace} or above it"
    parameter = wait_for_parameter(
        DESCRIPTION,
        namespace,
        lambda: notify(f"waiting for the {place}."),
        DESCRIPTION_TIMEOUT,
    )
    if not parameter:
        raise NoAnswerError(f"No {place}; is the robot launched?")
    return read_robot(parameter)
