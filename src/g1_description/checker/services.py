"""The services that check configurations and motions, and find configurations.

Services: ~check_state (g1_description/CheckState),
    ~check_trajectory (g1_description/CheckTrajectory),
    ~why (std_srvs/Trigger),
    ~solve_ik (g1_description/SolveIK)
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import rospy
from geometry_msgs.msg import Point
from sensor_msgs.msg import JointState
from std_srvs.srv import Trigger, TriggerRequest, TriggerResponse

from g1_description.checker.objects import CheckedObjects, CheckerAmongObjects
from g1_description.checks.checker import Checker
from g1_description.checks.first_cause import failure_text
from g1_description.checks.verdict import Finding, Verdict
from g1_description.choices import ZERO
from g1_description.collisions.self_collisions import SelfCollisions
from g1_description.errors import (
    G1DescriptionError,
    InvalidValueError,
    MotionError,
)
from g1_description.ik.inverse_kinematics import InverseKinematics
from g1_description.ik.options import IkOptions
from g1_description.motion.motion import Motion, configuration
from g1_description.msg import Finding as FindingMessage
from g1_description.robot.arrays import as_array
from g1_description.robot.description import Description
from g1_description.robot.poses import Pose, pose_positions
from g1_description.robot.state import RobotState
from g1_description.robot.transform import IDENTITY
from g1_description.ros.conversions import (
    joint_states_to_arrays,
    pose_from_array,
    pose_to_array,
)
from g1_description.ros.history import fetch_commands, fetch_history
from g1_description.ros.map_frame import MapFrame
from g1_description.ros.motion_messages import (
    pose_from_numbers,
    whole_body_from_message,
)
from g1_description.scenes.carried import RobotLinks, carried_to
from g1_description.scenes.scene import Scene
from g1_description.srv import (
    CheckState,
    CheckStateRequest,
    CheckStateResponse,
    CheckTrajectory,
    CheckTrajectoryRequest,
    CheckTrajectoryResponse,
    SolveIK,
    SolveIKRequest,
    SolveIKResponse,
)

EXPLAINED = 60.0
"""Time before now in which failures are explained, in [s]."""


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


class CheckServices:
    """The services; each connection has its own thread."""

    def __init__(
        self,
        checker: CheckerAmongObjects,
        lock: threading.Lock,
        make_checker: Callable[[], CheckerAmongObjects],
        present: Callable[[], RobotState | None],
        frame: MapFrame,
    ) -> None:
        """Advertise the services.

        Args:
            checker: Checks single configurations.
            lock: Locked while it is used.
            make_checker: Creates a second checker for motions, which may take seconds.
            present: Returns the state of the robot; None if it is unknown.
            frame: Transforms bases to the map.
        """
        self._checker, self._lock = checker, lock
        self._make_checker = make_checker
        self._motion_checker: CheckerAmongObjects | None = None
        self._motion_lock = threading.Lock()
        self._present, self._frame = present, frame
        robot = checker.newest()[0].description
        self._links = RobotLinks(robot)
        self._joints = dict.fromkeys(joint.name for joint in robot.movable_joints)
        rospy.Service("~check_state", CheckState, self._check_state)
        rospy.Service("~check_trajectory", CheckTrajectory, self._check_trajectory)
        rospy.Service("~why", Trigger, self._why)

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
                checker, objects = self._around(
                    self._checker, configuration(positions, base)
                )
                verdict = checker.check_state(
                    positions, base, request.only, velocities or None, objects
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
                checker, objects = self._around(self._for_motions(), motion)
                verdict = checker.check(motion, request.only, objects)
        except G1DescriptionError as error:
            return CheckTrajectoryResponse(status_message=str(error))
        return _answer(CheckTrajectoryResponse, verdict)

    def _why(self, _: TriggerRequest) -> TriggerResponse:
        """Explain the last failure that the bridge still knows."""
        given = EXPLAINED, rospy.get_namespace()
        try:
            states, commands = fetch_history(*given)[0], fetch_commands(*given)
            with self._motion_lock:
                checker = self._for_motions().newest()[0]
                found = checker.explain(states, commands)
            return TriggerResponse(True, failure_text(found, states))
        except G1DescriptionError as error:
            return TriggerResponse(False, str(error))

    def _for_motions(self) -> CheckerAmongObjects:
        """Return the checker of motions; it is prepared at the first call."""
        if self._motion_checker is None:
            self._motion_checker = self._make_checker()
        return self._motion_checker

    def _around(
        self, among: CheckerAmongObjects, motion: Motion
    ) -> tuple[Checker, np.ndarray | None]:
        """Return a checker, and the poses of the objects when a motion begins."""
        checker, objects = among.newest()
        if checker.obstacles is not None:
            given = [*checker.obstacles.scene.values()], objects, self._links
            objects = carried_to(*given, self._present(), motion)
        return checker, objects


def _answer(kind, verdict: Verdict):
    """Convert a verdict to the response of either service."""
    skipped = [f"{name}: {reason}" for name, reason in verdict.skipped.items()]
    if verdict.nothing_made:
        return kind(status_message=verdict.nothing_made, skipped=skipped)
    return kind(
        True,
        verdict.passed,
        verdict.severity,
        [finding_message(finding) for finding in verdict.findings],
        list(verdict.checked),
        skipped,
        " ".join(verdict.notes),
    )


class IkService:
    """The service; each connection has its own thread."""

    def __init__(
        self,
        robot: Description,
        make_collisions: Callable[[], SelfCollisions],
        objects: CheckedObjects,
        present: Callable[[], RobotState | None],
        frame: MapFrame,
    ) -> None:
        """Advertise the service.

        Args:
            robot: The robot.
            make_collisions: Prepares its self-collisions, which may take seconds.
            objects: The objects around it.
            present: Returns the state of the robot; None if it is unknown.
            frame: Transforms targets to the map.
        """
        self._objects, self._links = objects, RobotLinks(robot)
        self._present, self._frame = present, frame
        self._names = tuple(joint.name for joint in robot.movable_joints)
        self._neutral = pose_positions(Pose(ZERO), robot)
        self._inverse = InverseKinematics(robot, make_collisions)
        self._lock = threading.Lock()
        rospy.Service("~solve_ik", SolveIK, self._solve)

    def _solve(self, request: SolveIKRequest) -> SolveIKResponse:
        """Answer a request."""
        try:
            targets = self._targets(request)
            positions, base = self._start(request)
            if request.hold and request.hold_nothing:
                raise InvalidValueError("hold must be empty with hold_nothing.")
            if request.has_base and not request.joint_state.name:
                raise InvalidValueError("base_pose needs joint_state with positions.")
            hold = () if request.hold_nothing else request.hold or None
            motion = "fixed" if request.fixed_base else None
            is_free = not request.avoid_collisions
            around = None if is_free else self._around(positions, base)
            options = IkOptions(
                fixed_links=hold,
                balance=request.balance,
                avoid_collisions=request.avoid_collisions,
                base_motion=motion,
                scene=around,
            )
            with self._lock:
                found = self._inverse.solve(targets, positions, base, options)
        except G1DescriptionError as error:
            return SolveIKResponse(status_message=str(error))
        errors = found.errors.values()
        return SolveIKResponse(
            True,
            found.reached,
            JointState(name=self._names, position=found.positions),
            pose_from_array(found.base),
            list(found.errors),
            [error.position for error in errors],
            [np.nan if e.rotation is None else e.rotation for e in errors],
            found.message,
        )

    def _around(self, positions: np.ndarray, base: np.ndarray) -> Scene | None:
        """Return the objects where they are as the search starts."""
        scene, poses = self._objects.newest()
        if scene is None or poses is None:
            return scene
        start = configuration(dict(zip(self._names, positions.tolist())), base)
        given = [*scene.values()], poses, self._links
        pairs = zip(scene.values(), carried_to(*given, self._present(), start))
        return Scene([replace(each, pose=pose) for each, pose in pairs])

    def _targets(self, request: SolveIKRequest) -> dict[str, np.ndarray]:
        """Read the targets in the map, by link."""
        names, poses = request.ik_link_names, request.pose_stamped_vector
        only = request.position_only or [False] * len(names)
        if not len(names) == len(poses) == len(only):
            raise InvalidValueError(
                "ik_link_names and pose_stamped_vector must have the same length, "
                f"position_only that or none (got {len(names)}, {len(poses)} and "
                f"{len(request.position_only)})."
            )
        repeated = [name for name in names if names.count(name) > 1]
        if repeated:
            raise InvalidValueError(f"{repeated[0]} has several targets.")
        targets = {}
        for name, stamped, is_free in zip(names, poses, only):
            pose = pose_to_array(stamped.pose)
            header = stamped.header
            pose = self._frame.pose_in_map(pose, header.frame_id, header.stamp)
            targets[name] = pose[:3] if is_free else pose
        return targets

    def _start(self, request: SolveIKRequest) -> tuple[np.ndarray, np.ndarray]:
        """Read the configuration at which the search starts."""
        base = IDENTITY
        if request.joint_state.name:
            names, positions, _ = joint_states_to_arrays(request.joint_state)
            own = dict(zip(names, positions.tolist()))
            if request.has_base:
                base = pose_from_numbers(pose_to_array(request.base_pose))
        else:
            state = self._present()
            if state is None or state.base_pose is None:
                missing = "state" if state is None else "base"
                raise InvalidValueError(
                    f"The {missing} of the robot is unknown: joint_state must have the "
                    "joints at which the search starts, or the checker needs a ~rate, "
                    "joint_states and TF."
                )
            own = {n: v for n, v in state.positions_by_name.items() if n in self._names}
            base = state.base_pose
        return as_array(own, self._names, self._neutral), base
