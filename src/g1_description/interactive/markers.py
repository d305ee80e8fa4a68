"""Interactive markers on links of a robot, which the whole body follows."""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable
from dataclasses import replace
from functools import partial

import genpy
import numpy as np
import rospy
from geometry_msgs.msg import Quaternion
from interactive_markers.interactive_marker_server import InteractiveMarkerServer
from interactive_markers.menu_handler import MenuHandler
from visualization_msgs.msg import (
    InteractiveMarker,
    InteractiveMarkerControl,
    InteractiveMarkerFeedback,
    Marker,
    MarkerArray,
)

from g1_description.checker.markers import KINDS, MarkerMaker
from g1_description.checks.marks import ORANGE
from g1_description.choices import GAZEBO
from g1_description.collisions.self_collisions import SelfCollisions
from g1_description.errors import G1DescriptionError, InvalidValueError, MotionError
from g1_description.ik.posing import Posing
from g1_description.msg import RobotTrajectory
from g1_description.robot.poses import fitting_poses
from g1_description.robot.transform import compose, translation
from g1_description.ros.conversions import pose_from_array, pose_to_array
from g1_description.ros.lifecycle import at_shutdown, quiet_when_closing
from g1_description.ros.log import ThrottledLog
from g1_description.ros.motion_messages import configuration_message, pose_from_numbers
from g1_description.ros.present_objects import PresentObjects
from g1_description.ros.robot_view import MAP, RobotView

SCALE = 0.25
"""Size of a marker, in [m]."""

BALL = 0.07
"""Diameter of the ball at its centre, in [m]."""

PERIOD = 0.1
"""Time between two updates of the markers, in [s] of wall time."""

MOVED = 1e-4
"""Distance in [m], and change of a quaternion, above which a link has moved."""

UNREACHED = "not reached"
"""Namespace in RViz of links at targets that are not reached."""

MESSAGES = "messages"
"""Namespace in RViz of the texts."""


class Server(InteractiveMarkerServer):
    """A server that also takes feedback while time stands still.

    The original rejects another client's for one second of simulated time after the
    last, and each client is another one at first.
    """

    def processFeedback(self, feedback: InteractiveMarkerFeedback) -> None:  # noqa: N802
        """Take feedback."""
        context = self.marker_contexts.get(feedback.marker_name)
        if context is not None:
            context.last_client_id = feedback.client_id
            super().processFeedback(feedback)

    def __del__(self) -> None:
        """Do nothing: topics are closed by then."""


class InteractiveMarkers:
    """The markers of one robot.

    Publishes: ~update (visualization_msgs/InteractiveMarkerUpdate), ~update_full
        (visualization_msgs/InteractiveMarkerInit), ~markers
        (visualization_msgs/MarkerArray), motion (g1_description/RobotTrajectory)
    Subscribes: ~feedback (visualization_msgs/InteractiveMarkerFeedback); objects as by
        ros.present_objects
    """

    def __init__(
        self, robot: RobotView, make_collisions: Callable[[], SelfCollisions]
    ) -> None:
        """Advertise the topics.

        Args:
            robot: The robot.
            make_collisions: Prepares its self-collisions, which may take seconds.

        Raises:
            InvalidValueError: If its profile names no links to drag.
        """
        self._robot, self._make_collisions = robot, make_collisions
        self._motion = rospy.Publisher(
            "motion", RobotTrajectory, queue_size=10, tcp_nodelay=True
        )
        self._texts = rospy.Publisher(
            "~markers", MarkerArray, queue_size=10, latch=True
        )
        self._posing = Posing(robot.description, lambda: robot.state, self._command)
        self._objects: PresentObjects | None = None
        if not self._posing.roles:
            raise InvalidValueError(
                f"The profile of {robot.description.name} names no links to drag; see "
                "links in docs/robots.md."
            )
        self._links = {link.name: link for link in robot.description.links}
        self._log = ThrottledLog()
        self._todo: deque[tuple[str, str, Callable[[], object]]] = deque()
        """Kinds, roles and actions; of equal kinds only the last is kept."""
        self._new = threading.Condition()
        self._dragged = ""
        """Role of the link that is dragged."""
        self._shown: dict[str, np.ndarray] = {}
        """Poses of the markers, by role."""
        self._has_text = False
        self._server = Server(rospy.get_name())

    def run(self) -> None:
        """Show the markers and obey them until the node is shut down.

        Raises:
            ROSInterruptException: If it is shut down before there is a state.
        """
        self._robot.wait_until(self._poses, None)
        for role, pose in self._poses().items():
            marker = make_marker(role, pose)
            self._server.insert(marker, partial(self._on_feedback, role))
        self._update_menus()
        rospy.loginfo(
            "Interactive markers are on %s/update, for RViz with its tool Interact.",
            rospy.get_name(),
        )
        at_shutdown(self._clear)
        due = 0.0
        while not rospy.is_shutdown():
            with self._new:
                wait = max(0.0, due - time.monotonic())
                if self._new.wait_for(lambda: self._todo, wait):
                    _, role, act = self._todo.popleft()
                else:
                    role, act = "", lambda: None
            with quiet_when_closing():
                try:
                    act()
                except G1DescriptionError as error:
                    self._log.warn("refused", str(error))
                    self._show(role, str(error))
                if time.monotonic() >= due:
                    due = time.monotonic() + PERIOD
                    self._follow()

    def _post(self, role: str, act: Callable[[], object], kind: str = "") -> None:
        """Let the thread of ``run`` do something; called by threads of rospy."""
        with self._new:
            if kind and self._todo and self._todo[-1][0] == kind:
                self._todo.pop()
            self._todo.append((kind, role, act))
            self._new.notify()

    def _command(self, positions: dict[str, float], base: np.ndarray) -> None:
        """Command a configuration."""
        self._motion.publish(configuration_message(positions, base))

    # --- markers ---

    def _clear(self) -> None:
        """Remove everything from RViz."""
        with quiet_when_closing():
            self._show("", "")
            self._server.clear()
            self._server.applyChanges()

    def _poses(self) -> dict[str, np.ndarray]:
        """Return the poses of markers on their links by role, if these are known."""
        state = self._robot.state
        if state is None or state.base_pose is None:
            return {}
        return self._posing.handle_poses(state)

    def _follow(self) -> None:
        """Put markers that are not dragged on their links."""
        for role, pose in self._poses().items():
            last = self._shown.get(role)
            is_there = last is not None and np.abs(pose - last).max() < MOVED
            if role != self._dragged and not is_there:
                self._shown[role] = pose
                self._server.setPose(role, pose_from_array(pose))
        self._server.applyChanges()

    def _show(self, role: str, text: str, target: np.ndarray | None = None) -> None:
        """Show a text over a marker, and its link at a target; or nothing."""
        if not (text or self._has_text):
            return
        self._has_text = bool(text)
        canvas = MarkerMaker(MAP, genpy.Time())
        canvas.markers.append(Marker(action=Marker.DELETEALL))
        place = self._shown.get(role) if target is None else target
        if text and place is not None:
            above = place[:3] + np.array([0.0, 0.0, SCALE])
            lines = text.replace(": ", ":\n").replace("; ", ";\n")
            canvas.text(MESSAGES, above, lines, 0.035, ORANGE)
        if target is not None:
            link = self._links[self._posing.roles[role]]
            back = translation(-self._posing.centers[role])
            for shape in link.visuals or link.collisions:
                if shape.kind in KINDS:
                    pose = compose(compose(target, back), shape.pose)
                    canvas.shape(UNREACHED, replace(shape, pose=pose), ORANGE, 0.5)
        self._texts.publish(MarkerArray(canvas.markers))

    # --- dragging ---

    def _on_feedback(self, role: str, feedback: InteractiveMarkerFeedback) -> None:
        """Take feedback, in a thread of rospy; of a drag only the newest pose."""
        if feedback.event_type == feedback.POSE_UPDATE:
            act = partial(self._drag, role, pose_to_array(feedback.pose))
            self._post(role, act, f"drag {role}")
        elif feedback.event_type in (feedback.MOUSE_DOWN, feedback.MOUSE_UP):
            is_down = feedback.event_type == feedback.MOUSE_DOWN
            self._post(role, partial(self._grab, role if is_down else ""))

    def _grab(self, role: str) -> None:
        """Begin a drag, or end it."""
        self._posing.end_drag()
        self._shown.pop(self._dragged, None)  # the marker may be off its link
        self._dragged = role
        self._show("", "")

    def _drag(self, role: str, numbers: np.ndarray) -> None:
        """Move the robot so that a link follows its marker."""
        try:
            target = pose_from_numbers(numbers)
        except MotionError:
            raise InvalidValueError(
                f"The pose of the marker {role} must be finite, with a quaternion of "
                "length 1; it is ignored."
            ) from None
        if role != self._dragged:
            self._grab(role)
        if self._objects is not None:
            model = rospy.get_namespace().strip("/")
            robot = self._robot.description
            self._posing.scene = self._objects.placed(robot, model)
        found = self._posing.drag(role, target, self._posing.centers[role])
        if found.reached:
            self._show("", "")
        else:
            self._show(role, found.message, target)

    # --- menus ---

    def _update_menus(self) -> None:
        """Write all menus."""
        poses = fitting_poses(self._robot.description)
        for role in self._posing.roles:
            self._menu(role, poses).apply(self._server, role)
        self._server.applyChanges()

    def _menu(self, role: str, poses: list[str]) -> MenuHandler:
        """Write the menu of a marker."""
        menu, posing = MenuHandler(), self._posing

        def add(title: str, act: Callable[[], object], parent: int | None = None):
            chosen = partial(self._choose, act)
            return menu.insert(
                title, parent, callback=lambda _: self._post(role, chosen)
            )

        def add_switch(title: str, act: Callable[[], object], is_on: bool) -> None:
            state = menu.CHECKED if is_on else menu.UNCHECKED
            menu.setCheckState(add(title, act), state)

        add_switch("Lock", partial(self._lock, role), role in posing.fixed_links)
        balance = "Balance" if posing.stands else "Balance (lock a foot first)"
        add_switch(balance, partial(self._switch, "balance"), posing.balance)
        add_switch("Avoid collisions", self._switch_collisions, posing.avoid_collisions)
        add("Mirror", posing.mirror)
        add("Undo", posing.undo)
        add("Redo", posing.redo)
        if poses:
            parent = menu.insert("Go to pose")
            for name in poses:
                add(name, partial(posing.reset, name), parent)
        add("Reset", partial(posing.reset, posing.standing_pose))
        return menu

    def _choose(self, act: Callable[[], object]) -> None:
        """Execute an entry of a menu; its marks and poses may have changed."""
        self._show("", "")
        try:
            act()
        finally:
            self._update_menus()

    def _lock(self, role: str) -> None:
        """Let a link stay, or no longer."""
        self._posing.fixed_links ^= {role}

    def _switch(self, name: str) -> None:
        """Turn a switch of the posing on or off."""
        setattr(self._posing, name, not getattr(self._posing, name))

    def _switch_collisions(self) -> None:
        """Avoid collisions, or no longer; their first use prepares them."""
        self._switch("avoid_collisions")
        if self._objects is None:
            self._objects = PresentObjects(GAZEBO, partial(rospy.logwarn, "%s"))
        if self._posing.avoid_collisions and not self._posing.is_prepared:
            rospy.loginfo("Preparing the shapes of the links to avoid collisions.")
            threading.Thread(target=self._prepare, daemon=True).start()

    def _prepare(self) -> None:
        """Prepare self-collisions."""
        try:
            shapes = self._make_collisions()
        except G1DescriptionError as error:
            rospy.logerr("Collisions cannot be avoided: %s", error)
            switch = partial(setattr, self._posing, "avoid_collisions", False)
            self._post("", partial(self._choose, switch))
            return
        self._post("", partial(self._posing.prepare, shapes))
        rospy.loginfo("The shapes are prepared; links keep away from each other.")


def make_marker(role: str, pose: np.ndarray) -> InteractiveMarker:
    """Make a marker with arrows, rings, and a ball to drag in the plane of the view.

    Args:
        role: Its name.
        pose: In the map, shape (7,).
    """
    marker = InteractiveMarker(name=role, scale=SCALE, pose=pose_from_array(pose))
    marker.description = role.replace("_", " ")
    # Without a stamp: then feedback comes in this frame, not in RViz' fixed frame.
    marker.header.frame_id = MAP
    for name, axis in (("x", (1, 0, 0)), ("z", (0, 1, 0)), ("y", (0, 0, 1))):
        turn = Quaternion(*np.sqrt(0.5) * np.array([*axis, 1.0]))
        for mode in ("MOVE_AXIS", "ROTATE_AXIS"):
            kind = getattr(InteractiveMarkerControl, mode)
            marker.controls.append(
                InteractiveMarkerControl(
                    name=f"{mode}_{name}", orientation=turn, interaction_mode=kind
                )
            )
    canvas = MarkerMaker("", genpy.Time())
    canvas.ball("", np.zeros(3), BALL, ORANGE, 0.5)
    marker.controls.append(
        InteractiveMarkerControl(
            name="ball",
            interaction_mode=InteractiveMarkerControl.MOVE_3D,
            always_visible=True,
            markers=canvas.markers,
        )
    )
    return marker
