"""Shows in RViz what was found of the robot as it is now.

Publishes: ~markers (visualization_msgs/MarkerArray), while somebody subscribes
"""

from __future__ import annotations

from g1_description.checker.markers import (
    LinkMarkers,
    MarkerMaker,
    MarkerPublisher,
    Place,
)
from g1_description.checker.parameters import CheckerParameters, base_frame
from g1_description.checks.checker import Checker
from g1_description.checks.marks import RobotMarks, red_links
from g1_description.checks.verdict import Verdict
from g1_description.robot.state import RobotState
from g1_description.ros.conversions import stamp_from_ns


class LiveMarkers:
    """Makes markers of what is new while somebody wants them."""

    def __init__(self, checker: Checker, parameters: CheckerParameters) -> None:
        """Advertise the topic.

        Args:
            checker: The robot's checks.
            parameters: The node's parameters.
        """
        robot = checker.description
        self._prefix, self._map = parameters.frame_prefix, parameters.map_frame
        self._base_frame = base_frame(robot, parameters)
        self._links = LinkMarkers(robot)
        self._marks = RobotMarks(
            robot,
            checker.thresholds.floor_height,
            parameters.limit_margin,
        )
        self._publisher = MarkerPublisher("~markers")
        self._newest: tuple[RobotState, Verdict] | None = None
        self._shown: tuple | None = None

    def show(self, state: RobotState, verdict: Verdict) -> None:
        """Show a state.

        Args:
            state: The state.
            verdict: What was found and measured.
        """
        self._newest = state, verdict

    def keep_up(self) -> None:
        """Send what is new, and newcomers all that is shown."""
        if self._newest is None or not self._publisher.is_wanted:
            self._shown = None
            self._publisher.forget()
            return
        state, verdict = self._newest
        place = None if state.base_pose is None else state.base_pose.tobytes()
        content = verdict.measured.positions.tobytes(), place, verdict.checked
        if content != self._shown:
            self._shown = content
            self._update(state, verdict)
        self._publisher.keep_up(stamp_from_ns(state.stamp))

    def _update(self, state: RobotState, verdict: Verdict) -> None:
        """Make the markers of a state."""
        frame = self._base_frame if state.base_pose is None else self._map
        others = MarkerMaker(Place(frame, stamp_from_ns(state.stamp)))
        self._marks.draw(others, verdict, state.base_pose)
        self._publisher.update(
            self._links.links(sorted(red_links(verdict)), self._prefix), others.markers
        )
