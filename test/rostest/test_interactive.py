"""Interactive markers: links are dragged as in RViz, and the whole body follows."""

import os
import subprocess
from copy import deepcopy

import numpy as np
import pytest
import rospy
import tf2_ros
from g1_description.msg import RobotTrajectory
from geometry_msgs.msg import Point, Pose, PoseStamped, Quaternion
from scipy.spatial.transform import Rotation
from sensor_msgs.msg import JointState
from std_msgs.msg import Header
from std_srvs.srv import Empty
from support.ros_testing import (
    DEADLINE,
    REPOSITORY,
    Connected,
    Listener,
    NodeLog,
    program,
    service,
    wait_for,
)
from visualization_msgs.msg import (
    InteractiveMarkerFeedback,
    InteractiveMarkerInit,
    InteractiveMarkerUpdate,
    MarkerArray,
)

from g1_description import Robot

HAND, OTHER_HAND = "left_rubber_hand", "right_rubber_hand"
FEET = ("left_ankle_roll_link", "right_ankle_roll_link")
ELBOWS = ("left_elbow_joint", "right_elbow_joint")
NEAR = 1e-3
"""[m]"""
G1 = Robot()
ROBOT = G1.description
CENTERS = {
    link.name: link.inertial.center_of_mass for link in ROBOT.links if link.inertial
}
ROLES = {"pelvis", "torso", "head"}
ROLES |= {f"{side}_{part}" for side in ("left", "right") for part in ("hand", "foot")}


def place_of(pose):
    return np.array([pose.position.x, pose.position.y, pose.position.z])


class Rviz:
    """What RViz does with the markers, as one of its windows."""

    def __init__(self, client="rviz"):
        self.client, self.markers = client, {}
        self._topics = [
            rospy.Subscriber(f"/interactive/{topic}", kind, self._came)
            for topic, kind in (
                ("update_full", InteractiveMarkerInit),
                ("update", InteractiveMarkerUpdate),
            )
        ]
        self._feedback = rospy.Publisher(
            "/interactive/feedback", InteractiveMarkerFeedback, queue_size=1000
        )
        wait_for(self._feedback.get_num_connections, "the node to listen")
        wait_for(lambda: set(self.markers) == ROLES, "the markers")

    def _came(self, message):
        for marker in message.markers:
            self.markers[marker.name] = marker
        for moved in getattr(message, "poses", ()):
            if moved.name in self.markers:
                self.markers[moved.name].pose = moved.pose

    def place(self, role):
        """Give where a marker is in the map, in [m]."""
        return place_of(self.markers[role].pose)

    def send(self, role, kind, pose=None, entry=0):
        message = InteractiveMarkerFeedback(client_id=self.client, marker_name=role)
        message.header.frame_id = "map"
        message.event_type, message.menu_entry_id = kind, entry
        message.pose = pose or self.markers[role].pose
        self._feedback.publish(message)

    def drag(self, role, by, steps=10, let_go=True):
        """Drag a marker with the mouse."""
        pose = deepcopy(self.markers[role].pose)
        self.send(role, InteractiveMarkerFeedback.MOUSE_DOWN)
        for _ in range(steps):
            pose.position.x += by[0] / steps
            pose.position.y += by[1] / steps
            pose.position.z += by[2] / steps
            update = InteractiveMarkerFeedback.POSE_UPDATE
            self.send(role, update, deepcopy(pose))
        if let_go:
            self.send(role, InteractiveMarkerFeedback.MOUSE_UP, pose)

    def titles(self, role):
        return [entry.title for entry in self.markers[role].menu_entries]

    def choose(self, role, title):
        """Choose from the menu of a marker, whatever is in front of the title."""
        (entry,) = (
            entry
            for entry in self.markers[role].menu_entries
            if entry.title.rpartition("] ")[2] == title
        )
        self.send(role, InteractiveMarkerFeedback.MENU_SELECT, entry=entry.id)

    def switch(self, role, title):
        """Choose a switch, and wait until the menu shows it."""
        is_on = f"[x] {title}" in self.titles(role)
        other = f"[{' ' if is_on else 'x'}] {title}"
        self.choose(role, title)
        wait_for(lambda: other in self.titles(role), f"{other} of {role}")

    def close(self):
        for topic in (*self._topics, self._feedback):
            topic.unregister()


class World:
    """Where links are on TF."""

    def __init__(self):
        self._buffer = tf2_ros.Buffer()
        self._listener = tf2_ros.TransformListener(self._buffer)
        self._joints = Connected("/joint_states", JointState)

    def place(self, frame, point=(0.0, 0.0, 0.0)):
        """Give the place of a link's point in the map, in [m]."""
        try:
            found = self._buffer.lookup_transform("map", frame, rospy.Time())
        except tf2_ros.TransformException:
            return np.full(3, np.nan)
        p, q = found.transform.translation, found.transform.rotation
        turned = Rotation.from_quat([q.x, q.y, q.z, q.w]).apply(point)
        return np.array([p.x, p.y, p.z]) + turned

    def is_at(self, frame, place):
        return np.abs(self.place(frame) - place).max() < NEAR

    def wait_at(self, frame, place):
        wait_for(lambda: self.is_at(frame, place), f"{frame} at {place}")

    def positions(self):
        """Give the newest positions of all joints in [rad], by name."""
        self._joints.clear()
        message = self._joints.wait()
        return dict(zip(message.name, message.position))

    def elbows(self):
        """Give those of the elbows."""
        positions = self.positions()
        return np.array([positions[joint] for joint in ELBOWS])

    def wait_for_markers(self, rviz):
        """Wait until all markers are at the centres of their links."""

        def are_there():
            return all(
                np.abs(self.place(link, CENTERS[link]) - rviz.place(role)).max() < NEAR
                for role, link in ROBOT.profile.links.items()
                if role in ROLES
            )

        wait_for(are_there, "the markers on the links")

    def wait_for_elbows(self, positions, tolerance=0.02):
        def are_there():
            return np.abs(self.elbows() - positions).max() < tolerance

        wait_for(are_there, f"elbows at {positions}")


@pytest.fixture(scope="module")
def world():
    return World()


@pytest.fixture(scope="module")
def window(world):
    one = Rviz()
    world.wait_for_markers(one)
    one.home = {role: one.place(role) for role in ROLES}
    yield one
    one.close()


@pytest.fixture
def rviz(window):
    """Give a window; the robot stands where it stood at first."""
    bases = rospy.Publisher("/base_command", PoseStamped, queue_size=1)
    wait_for(bases.get_num_connections, "the bridge to listen")
    pose = Pose(Point(0.0, 0.0, 2.0), Quaternion(0.0, 0.0, 0.0, 1.0))
    bases.publish(PoseStamped(Header(frame_id="map"), pose))
    wait_for(lambda: window.place("head")[2] > 1.5, "a robot in the air")
    window.choose("pelvis", "Reset")

    def is_home():
        return all(
            np.abs(window.place(role) - place).max() < NEAR
            for role, place in window.home.items()
        )

    wait_for(is_home, "a robot that stands")
    bases.unregister()
    return window


def test_the_body_follows_a_hand_and_the_feet_stay(rviz, world):
    feet = [world.place(foot) for foot in FEET]
    hand, head = world.place(HAND), rviz.place("head")
    by = np.array([0.25, 0.05, -0.25])
    rviz.drag("left_hand", by)
    world.wait_at(HAND, hand + by)
    assert all(world.is_at(foot, place) for foot, place in zip(FEET, feet))
    wait_for(lambda: rviz.place("head")[0] > head[0] + 0.02, "the marker of the head")


def test_a_marker_goes_where_its_link_is_moved_otherwise(rviz):
    commands = rospy.Publisher("/joint_commands", JointState, queue_size=1)
    wait_for(commands.get_num_connections, "the bridge to listen")
    before = rviz.place("left_hand")
    commands.publish(JointState(name=[ELBOWS[0]], position=[1.5]))
    wait_for(
        lambda: np.linalg.norm(rviz.place("left_hand") - before) > 0.05, "the marker"
    )
    commands.unregister()


def test_of_many_poses_only_the_newest_are_used(rviz, world):
    motions = Connected("/motion", RobotTrajectory)
    hand = world.place(HAND)
    by = np.array([0.1, 0.0, 0.05])
    rviz.drag("left_hand", by, steps=500)
    world.wait_at(HAND, hand + by)
    assert len(motions.messages) < 400
    motions.close()


def test_a_locked_link_stays_and_a_free_one_does_not(rviz, world):
    assert "[x] Lock" in rviz.titles("left_foot")
    assert "[ ] Lock" in rviz.titles("right_hand")
    down = np.array([0.0, 0.0, -0.05])
    rviz.switch("right_hand", "Lock")
    pelvis, hand = world.place("pelvis"), world.place(OTHER_HAND)
    rviz.drag("pelvis", down)
    world.wait_at("pelvis", pelvis + down)
    world.wait_for_markers(rviz)
    assert world.is_at(OTHER_HAND, hand)
    rviz.switch("right_hand", "Lock")
    rviz.drag("pelvis", down)
    world.wait_at("pelvis", pelvis + 2 * down)
    wait_for(lambda: not world.is_at(OTHER_HAND, hand), "the free hand to go along")


def test_that_balance_needs_a_foot_is_in_the_menu(rviz):
    feet = "left_foot", "right_foot"
    for foot in feet:
        assert "[x] Balance" in rviz.titles("head")
        rviz.switch(foot, "Lock")
    title = "[x] Balance (lock a foot first)"
    wait_for(lambda: title in rviz.titles("head"), title)
    for foot in feet:
        rviz.switch(foot, "Lock")
    wait_for(lambda: "[x] Balance" in rviz.titles("head"), "balance")


def test_a_robot_is_mirrored_and_changes_are_undone(rviz, world):
    first = world.elbows()
    hand, by = world.place(HAND), np.array([0.15, 0.1, 0.2])
    rviz.drag("left_hand", by)
    world.wait_at(HAND, hand + by)
    world.wait_for_markers(rviz)
    second = world.elbows()
    assert abs(second[0] - second[1]) > 0.1
    rviz.choose("head", "Mirror")
    world.wait_at(OTHER_HAND, (hand + by) * [1.0, -1.0, 1.0])
    world.wait_for_elbows(second[::-1])
    world.wait_for_markers(rviz)
    rviz.choose("head", "Undo")
    world.wait_for_elbows(second)
    world.wait_for_markers(rviz)
    rviz.choose("head", "Undo")
    world.wait_for_elbows(first, 1e-6)
    rviz.choose("head", "Redo")
    world.wait_for_elbows(second)


def test_a_pose_is_taken_where_the_robot_stands(rviz, world):
    pelvis, by = world.place("pelvis"), np.array([0.03, 0.02, -0.1])
    rviz.drag("pelvis", by)
    world.wait_at("pelvis", pelvis + by)
    world.wait_for_markers(rviz)
    rviz.choose("torso", "squat")
    low = pelvis[2] - 0.2
    wait_for(lambda: world.place("pelvis")[2] < low, "a robot that squats")
    np.testing.assert_allclose(world.place("pelvis")[:2], by[:2], atol=NEAR)
    rviz.choose("torso", "Undo")
    wait_for(lambda: world.place("pelvis")[2] > low + 0.05, "a robot that stands up")
    world.wait_for_markers(rviz)
    np.testing.assert_allclose(world.place("pelvis"), pelvis + by, atol=2 * NEAR)


def test_what_is_not_reached_is_shown_until_the_mouse_lets_go(rviz):
    shown = Listener("/interactive/markers", MarkerArray)
    by = np.array([1.5, 0.0, 0.0])
    target = rviz.place("left_hand") + by
    rviz.drag("left_hand", by, let_go=False)

    def has_all(message):
        texts = [m.text for m in message.markers if m.text]
        ghosts = [m for m in message.markers if m.ns == "not reached"]
        near = [np.linalg.norm(place_of(m.pose) - target) < 0.15 for m in ghosts]
        return any("left_hand is" in text for text in texts) and near and all(near)

    shown.wait(has_all, "a text, and the hand at its target")
    shown.clear()
    rviz.send("left_hand", InteractiveMarkerFeedback.MOUSE_UP)
    shown.wait(lambda message: len(message.markers) == 1, "nothing")
    wait_for(
        lambda: np.linalg.norm(rviz.place("left_hand") - target) > 0.3,
        "the marker back on the hand",
    )
    shown.close()


def test_links_keep_away_from_each_other_where_that_is_chosen(rviz, world):
    log = NodeLog("/interactive")
    rviz.switch("head", "Avoid collisions")
    log.wait(lambda message: "shapes are prepared" in message.msg, "the shapes")
    hand = world.place(HAND)
    rviz.drag("left_hand", [0.1, -0.21, 0.1])  # where both hands collide
    wait_for(lambda: world.place(HAND)[1] < hand[1] - 0.1, "the hand")
    world.wait_for_markers(rviz)
    assert len(G1.self_collisions(world.positions()).pair) == 0
    rviz.switch("head", "Avoid collisions")
    log.close()


def test_a_refusal_is_shown_at_the_marker(rviz):
    rviz.choose("head", "Undo")  # so that something else could be done again
    rviz.choose("head", "Mirror")
    shown = Listener("/interactive/markers", MarkerArray)
    rviz.choose("left_hand", "Redo")
    text = "There is nothing to redo."
    shown.wait(lambda message: text in [m.text for m in message.markers], text)
    shown.close()


def test_a_refused_pose_moves_nothing_and_the_marker_returns(rviz, world):
    shown = Listener("/interactive/markers", MarkerArray)
    hand, home = world.place(HAND), rviz.place("left_hand")
    pose = deepcopy(rviz.markers["left_hand"].pose)
    pose.position.x += 0.2
    pose.orientation = Quaternion(0.0, 0.0, 0.0, 0.5)
    rviz.send("left_hand", InteractiveMarkerFeedback.MOUSE_DOWN)
    rviz.send("left_hand", InteractiveMarkerFeedback.POSE_UPDATE, pose)

    def is_refused(message):
        return any("quaternion" in marker.text for marker in message.markers)

    shown.wait(is_refused, "a sentence on the quaternion")
    wait_for(lambda: rviz.place("left_hand")[0] > home[0] + 0.1, "the marker")
    rviz.send("left_hand", InteractiveMarkerFeedback.MOUSE_UP, pose)
    wait_for(lambda: np.abs(rviz.place("left_hand") - home).max() < NEAR, "it again")
    assert world.is_at(HAND, hand)
    shown.close()


def test_another_window_drags_while_time_stands_still(rviz, world):
    service("/gazebo/pause_physics", Empty)()
    try:
        hand, by = world.place(HAND), np.array([0.05, 0.0, 0.05])
        rviz.drag("left_hand", by)
        world.wait_at(HAND, hand + by)
        other = Rviz("another")
        world.wait_for_markers(other)
        other.drag("left_hand", -by)
        world.wait_at(HAND, hand)
        other.close()
    finally:
        service("/gazebo/unpause_physics", Empty)()


def output_of_node(*arguments, **changes):
    """Run the node until it ends by itself with an error; give what it says."""
    run = subprocess.run(
        [program("interactive.py"), *arguments],
        env={**os.environ, **changes},
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        timeout=DEADLINE,
    )
    assert run.returncode == 1
    assert "Traceback" not in run.stdout
    return run.stdout


def test_without_the_package_the_node_says_how_to_get_it(tmp_path):
    missing = "raise ModuleNotFoundError('No module', name='interactive_markers')\n"
    (tmp_path / "interactive_markers.py").write_text(missing)
    path = os.pathsep.join([str(tmp_path), os.environ.get("PYTHONPATH", "")])
    said = output_of_node("__name:=without", PYTHONPATH=path)
    assert "python3-interactive-markers on Debian" in said


def test_a_robot_without_links_in_its_profile_is_refused():
    urdf = (REPOSITORY / "test" / "data" / "five_links.urdf").read_text()
    rospy.set_param("/other/robot_description", urdf)
    assert "names no links to drag" in output_of_node("__ns:=/other")
