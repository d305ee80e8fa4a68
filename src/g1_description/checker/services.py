"""The services that check configurations and motions.

Services: ~check_state (g1_description/CheckState),
    ~check_trajectory (g1_description/CheckTrajectory)
"""

from __future__ import annotations

import threading
from collections.abc import Callable

import rospy
from geometry_msgs.msg import Point

from g1_description.checks.checker import Checker
from g1_description.checks.verdict import Finding, Verdict
from g1_description.errors import G1DescriptionError, MotionError
from g1_description.msg import Finding as FindingMessage
from g1_description.ros.conversions import joint_states_to_arrays, pose_to_array
from g1_description.ros.map_frame import MapFrame
from g1_description.ros.motion_messages import (
    pose_from_numbers,
    whole_body_from_message,
)
from g1_description.srv import (
    CheckState,
    CheckStateRequest,
    CheckStateResponse,
    CheckTrajectory,
    CheckTrajectoryRequest,
    CheckTrajectoryResponse,
)


def finding_message(finding: Finding) -> FindingMessage:
    """Convert a finding."""
    return FindingMessage(
        finding.check,
        finding.severity,
        list(finding.subject),
        finding.worst,
        finding.bound,
        finding.unit,
        finding.first_time,
        finding.worst_time,
        finding.share,
        [Point(*point) for point in finding.points],
        finding.text,
    )


def skipped_lines(verdict: Verdict) -> list[str]:
    """List the skipped checks, each with the reason."""
    return [f"{name}: {reason}" for name, reason in verdict.skipped.items()]


class CheckServices:
    """The services; each connection has its own thread."""

    def __init__(
        self,
        checker: Checker,
        lock: threading.Lock,
        make_checker: Callable[[], Checker],
        frame: MapFrame,
    ) -> None:
        """Advertise the services.

        Args:
            checker: Checks single configurations.
            lock: Locked while it is used.
            make_checker: Creates a second checker for motions, which may take seconds.
            frame: Transforms bases to the map.
        """
        self._checker, self._lock = checker, lock
        self._make_checker = make_checker
        self._motion_checker: Checker | None = None
        self._motion_lock = threading.Lock()
        self._frame = frame
        self._joints = dict.fromkeys(
            joint.name for joint in checker.description.movable_joints
        )
        rospy.Service("~check_state", CheckState, self._check_state)
        rospy.Service("~check_trajectory", CheckTrajectory, self._check_trajectory)

    def _check_state(self, request: CheckStateRequest) -> CheckStateResponse:
        """Check a configuration."""
        try:
            joints, base = request.joint_state, None
            names, *numbers = joint_states_to_arrays(joints)
            positions, velocities = (
                {} if array is None else dict(zip(names, array.tolist()))
                for array in numbers
            )
            if request.has_base:
                base = pose_from_numbers(pose_to_array(request.base_pose))
            with self._lock:
                verdict = self._checker.check_state(
                    positions, base, request.only, velocities or None
                )
        except G1DescriptionError as error:
            return CheckStateResponse(status_message=str(error))
        return _answer(CheckStateResponse, verdict)

    def _check_trajectory(
        self, request: CheckTrajectoryRequest
    ) -> CheckTrajectoryResponse:
        """Check a motion."""
        try:
            motion = whole_body_from_message(
                request.trajectory, self._joints, self._frame
            )
            if motion is None:
                raise MotionError("The trajectory has no points.")
            with self._motion_lock:
                if self._motion_checker is None:
                    self._motion_checker = self._make_checker()
                verdict = self._motion_checker.check(motion, request.only)
        except G1DescriptionError as error:
            return CheckTrajectoryResponse(status_message=str(error))
        return _answer(CheckTrajectoryResponse, verdict)


def _answer(kind, verdict: Verdict):
    """Convert a verdict to the response of either service."""
    if verdict.nothing_made:
        return kind(status_message=verdict.nothing_made, skipped=skipped_lines(verdict))
    return kind(
        True,
        verdict.passed,
        verdict.severity,
        [finding_message(finding) for finding in verdict.findings],
        list(verdict.checked),
        skipped_lines(verdict),
        " ".join(verdict.notes),
    )
