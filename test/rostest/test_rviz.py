"""RViz shows one robot, two robots and the robot of a bag, each where and how it is.

Parameters: ~model: URDF of the one robot
    ~rviz: arguments of rviz.launch
    ~pictures: folder for the pictures; otherwise only a failure leaves one
"""

import numpy as np
import pytest
import rospy
import tf2_ros
from gazebo_msgs.msg import ModelState
from gazebo_msgs.srv import SetModelState
from geometry_msgs.msg import Point, Pose, Quaternion, TransformStamped, Vector3
from rosgraph_msgs.msg import Clock, Log
from sensor_msgs.msg import JointState
from std_msgs.msg import Header
from support.ros_testing import (
    DEADLINE,
    REPOSITORY,
    Connected,
    Launch,
    Listener,
    Repeated,
    is_at,
    wait_for,
)
from support.rviz_window import (
    RvizWindow,
    complaints_in,
    dark,
    different,
    extent,
    is_calm,
    length,
    view_of,
)
from tf2_msgs.msg import TFMessage

from g1_description.robot.urdf import parse_urdf

STANDING = 0.793
"""[m] The pelvis above the floor."""
OUT_OF_VIEW = 100.0
"""[m]"""
ARMS = {
    "left_shoulder_roll_joint": (0.0, 1.2),
    "right_shoulder_roll_joint": (0.0, -1.2),
    "left_elbow_joint": (0.0, 1.57),
    "right_elbow_joint": (0.0, 1.57),
}
"""[rad] Hanging with the forearms forward, and stretched out to the sides."""
PLACES = {"left": 0.7, "right": -0.7}
"""[m] along y."""
ELBOW, HAND = "left_elbow_joint", "left_wrist_yaw_link"
FAR = 6.0
"""[m] from the map's origin along x."""
PERIOD = 0.05


@pytest.fixture
def closing():
    """Give what closes something after the test, the last one first."""
    closed = []
    yield lambda thing, close="close": closed.append(getattr(thing, close)) or thing
    for close in reversed(closed):
        close()


@pytest.fixture
def place(closing):
    """Give what returns a frame's place in the map, None while it is not known."""
    buffer = tf2_ros.Buffer()
    closing(tf2_ros.TransformListener(buffer), "unregister")

    def look_up(frame):
        try:
            found = buffer.lookup_transform("map", frame, rospy.Time())
        except tf2_ros.TransformException:
            return None
        where = found.transform.translation
        return [round(number, 6) for number in (where.x, where.y, where.z)]

    return look_up


# --- one robot ----------------------------------------------------------------------


class Robot:
    """The robot of the display, moved from here."""

    def __init__(self):
        self._commands = rospy.Publisher("/joint_commands", JointState, queue_size=1)
        wait_for(self._commands.get_num_connections, "the bridge to listen", DEADLINE)
        rospy.wait_for_service("/gazebo/set_model_state", DEADLINE)
        self._set = rospy.ServiceProxy("/gazebo/set_model_state", SetModelState)

    def lift(self, height):
        """Set the pelvis upright above the origin."""
        pose = Pose(Point(0.0, 0.0, height), Quaternion(0.0, 0.0, 0.0, 1.0))
        answer = self._set(ModelState(model_name="g1_robot", pose=pose))
        assert answer.success, answer.status_message

    def move_arms(self, which):
        """Let them hang (0) or stretch them out (1)."""
        positions = [positions[which] for positions in ARMS.values()]
        self._commands.publish(JointState(name=list(ARMS), position=positions))


def is_standing(seen):
    """Whether a whole robot fills the height and stands in the middle."""
    height, width = seen.shape
    rows, columns = extent(seen)
    middle = (columns.start + columns.stop) / 2
    return (
        rows.start > 0.05 * height
        and rows.stop < 0.95 * height
        and length(rows) > 0.6 * height
        and columns.start > 0.05 * width
        and columns.stop < 0.95 * width
        and abs(middle - width / 2) < 0.1 * width
    )


def check_colours(robot):
    """Check the pixels of the robot: white and dark, with light and shade."""
    brightness = robot.mean(axis=1)
    assert np.percentile(np.ptp(robot, axis=1), 90) < 15, "not grey"
    assert (brightness > 125).mean() > 0.3, "hardly any white"
    assert (brightness < 60).mean() > 0.05, "hardly anything dark"
    assert len(np.unique(robot, axis=0)) > 30, "no light and shade"


def test_the_robot_is_seen_in_its_colours_and_its_arms_move(closing):
    log = closing(Listener("/rosout", Log))
    model = f"model:={rospy.get_param('~model')}"
    closing(Launch("display.launch", "rviz:=false", "rate:=50", model), "stop")
    robot = Robot()
    robot.lift(OUT_OF_VIEW)
    arguments = rospy.get_param("~rviz", "").split()
    window = closing(RvizWindow("g1.rviz", "rviz.launch", *arguments))
    empty = window.picture_when(is_calm, "an empty view without complaints")
    view = window.view = view_of(empty)

    def silhouette(picture):
        return different(picture, empty)[view]

    robot.lift(STANDING)
    hanging = window.picture_when(
        lambda picture: is_standing(silhouette(picture)), "the robot standing"
    )
    check_colours(hanging[view][silhouette(hanging)].astype(int))

    rows, columns = extent(silhouette(hanging))
    reach = 0.1 * length(rows)

    def is_stretched(picture):
        now = extent(silhouette(picture))[1]
        return (
            now.start < columns.start - reach
            and now.stop > columns.stop + reach
            and not complaints_in(picture)
        )

    robot.move_arms(1)
    stretched = window.picture_when(is_stretched, "arms stretched out")
    moved = different(hanging, stretched)[view]
    half = (rows.start + rows.stop) // 2
    assert moved[:half].sum() > 2000
    assert not moved[half:].any(), "more than the arms moved"

    log.wait(lambda message: message.name == "/rviz", "RViz's log")
    said = [m for m in log.messages if m.name == "/rviz" and m.level >= Log.ERROR]
    assert [message.msg for message in said] == []


# --- two robots ---------------------------------------------------------------------


def test_two_robots_stand_side_by_side_and_each_has_its_own_joints(closing, place):
    launch = "two_robots.launch", "gui:=false", "rate:=50"
    window = closing(RvizWindow("two_robots.rviz", *launch))
    for name, y in PLACES.items():
        wait_for(
            lambda name=name, y=y: place(f"{name}/pelvis") == [0, y, STANDING],
            f"the {name} robot at y = {y}",
        )
        wait_for(lambda name=name: place(f"{name}/head_link"), "its head")

    topics = {name: f"/{name}/joint_states" for name in PLACES}
    states = {n: closing(Connected(t, JointState)) for n, t in topics.items()}
    commands = rospy.Publisher("/left/joint_commands", JointState, queue_size=1)
    wait_for(commands.get_num_connections, "the bridge to listen")
    commands.publish(JointState(name=[ELBOW], position=[0.5]))
    states["left"].wait(lambda message: is_at(message, ELBOW, 0.5), "a bent elbow")
    states["right"].clear()
    assert is_at(states["right"].wait(), ELBOW, 0.0)

    def shows_both(picture):
        if not is_calm(picture):
            return False
        seen = dark(picture[view_of(picture)])
        height, width = seen.shape
        halves = seen[:, : width // 2], seen[:, width // 2 :]
        between = seen[:, int(0.45 * width) : int(0.55 * width)]
        whole = [length(extent(half)[0]) > 0.4 * height for half in halves]
        return all(whole) and not between.any()

    window.picture_when(shows_both, "two robots side by side")


# --- without a simulator ------------------------------------------------------------


def transform(stamp, parent, child, x=0.0, z=0.0):
    found = TransformStamped(Header(stamp=stamp, frame_id=parent), child, None)
    found.transform.translation = Vector3(x, 0.0, z)
    found.transform.rotation = Quaternion(0.0, 0.0, 0.0, 1.0)
    return found


def joints(stamp):
    """Give joint states, all joints at zero."""
    robot = parse_urdf((REPOSITORY / "urdf" / "g1_29dof.urdf").read_text())
    names = [joint.name for joint in robot.movable_joints]
    return JointState(Header(stamp=stamp), names, [0.0] * len(names), [], [])


class Bag:
    """A bag of a robot far away, as ``rosbag play --clock`` plays it."""

    def __init__(self):
        def publisher(topic, kind, latch=False):
            return rospy.Publisher(topic, kind, queue_size=10, latch=latch)

        self.time = rospy.Time(1000)
        self._clock = publisher("/clock", Clock)
        self._tf = publisher("/tf", TFMessage)
        self._states = publisher("/joint_states", JointState)
        fixed = transform(self.time, "base_link", "pelvis")
        self._static = publisher("/tf_static", TFMessage, latch=True)
        self._static.publish(TFMessage([fixed]))
        self._joints = joints(self.time)
        self._repeated = Repeated(self._play, PERIOD)

    def _play(self):
        self.time += rospy.Duration(PERIOD)
        self._clock.publish(self.time)
        base = transform(self.time, "map", "base_link", FAR, STANDING)
        self._tf.publish(TFMessage([base]))
        self._joints.header.stamp = self.time
        self._states.publish(self._joints)

    def close(self):
        self._repeated.close()
        for topic in (self._clock, self._tf, self._states, self._static):
            topic.unregister()


def test_a_bag_is_seen_wherever_its_robot_is_and_when_it_begins_again(closing):
    window = closing(RvizWindow("view.rviz", "view.launch", "use_sim_time:=true"))
    bag = closing(Bag())

    def is_in_the_middle(picture):
        if not is_calm(picture):
            return False
        seen = dark(picture[view_of(picture)])
        rows, columns = extent(seen)
        middle = (columns.start + columns.stop) / 2
        height, width = seen.shape
        return length(rows) > 0.6 * height and abs(middle - width / 2) < 0.1 * width

    window.picture_when(is_in_the_middle, "the robot of a bag")
    frames = closing(Listener("/tf", TFMessage))
    bag.time = rospy.Time(1000)

    def has_the_hand(message):
        stamps = {t.child_frame_id: t.header.stamp for t in message.transforms}
        return rospy.Time(1000) < stamps.get(HAND, rospy.Time()) < rospy.Time(1005)

    frames.wait(has_the_hand, "the hand after the bag began again")


def test_a_real_robot_is_put_where_nobody_tells_it_is(closing, place):
    closing(Launch("view.launch", "rviz:=false", "base:=1 2 0.793 0 0 0"), "stop")
    states = closing(
        rospy.Publisher("/joint_states", JointState, queue_size=1), "unregister"
    )
    message = joints(rospy.Time.now())

    def publish():
        message.header.stamp = rospy.Time.now()
        states.publish(message)

    closing(Repeated(publish, PERIOD))
    wait_for(lambda: place(HAND), "the hand in map")
    assert place("pelvis") == [1.0, 2.0, STANDING]
