"""RViz without a simulator: for a bag, whose robot is far away, and a real robot."""

import unittest
import xml.etree.ElementTree as ET

import rospy
import tf2_ros
from geometry_msgs.msg import Quaternion, TransformStamped, Vector3
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState
from std_msgs.msg import Header
from support.ros_testing import Launch, Listener, Repeated, wait_for
from support.rviz_window import RvizWindow, dark, extent, is_calm, length, view_of
from tf2_msgs.msg import TFMessage

PERIOD = 0.05
FAR = 6.0
"""[m] from the map's origin along x."""
HAND = "left_wrist_yaw_link"


def transform(stamp, parent, child, x=0.0, z=0.0):
    found = TransformStamped(Header(stamp=stamp, frame_id=parent), child, None)
    found.transform.translation = Vector3(x, 0.0, z)
    found.transform.rotation = Quaternion(0.0, 0.0, 0.0, 1.0)
    return found


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
        self._repeated = Repeated(self._play, PERIOD)

    def _play(self):
        self.time += rospy.Duration(PERIOD)
        self._clock.publish(self.time)
        base = transform(self.time, "map", "base_link", FAR, 0.793)
        self._tf.publish(TFMessage([base]))
        self._states.publish(joints(self.time))

    def close(self):
        self._repeated.close()
        for topic in (self._clock, self._tf, self._states, self._static):
            topic.unregister()


def joints(stamp):
    """Give joint states, all joints at zero."""
    urdf = ET.fromstring(rospy.get_param("/robot_description", "<robot/>"))
    movable = [j.get("name") for j in urdf.iter("joint") if j.get("type") == "revolute"]
    return JointState(Header(stamp=stamp), movable, [0.0] * len(movable), [], [])


class TestView(unittest.TestCase):
    def test_a_bag_is_seen_wherever_its_robot_is_and_when_it_begins_anew(self):
        window = RvizWindow("view.rviz", "view.launch", "use_sim_time:=true")
        self.addCleanup(window.close)
        bag = Bag()
        self.addCleanup(bag.close)

        def is_in_the_middle(picture):
            if not is_calm(picture):
                return False
            seen = dark(picture[view_of(picture)])
            rows, columns = extent(seen)
            middle = (columns.start + columns.stop) / 2
            return (
                length(rows) > 0.6 * seen.shape[0]
                and abs(middle - seen.shape[1] / 2) < 0.1 * seen.shape[1]
            )

        window.picture_when(is_in_the_middle, "the robot of a bag")
        frames = Listener("/tf", TFMessage)
        self.addCleanup(frames.close)
        bag.time = rospy.Time(1000)

        def has_the_hand(message):
            stamps = {t.child_frame_id: t.header.stamp for t in message.transforms}
            return rospy.Time(1000) < stamps.get(HAND, rospy.Time()) < rospy.Time(1005)

        frames.wait(has_the_hand, "the hand after the bag began anew")

    def test_a_real_robot_is_put_where_nobody_tells_it_is(self):
        launch = Launch("view.launch", "rviz:=false", "base:=1 2 0.793 0 0 0")
        self.addCleanup(launch.stop)
        states = rospy.Publisher("/joint_states", JointState, queue_size=1)
        repeated = Repeated(lambda: states.publish(joints(rospy.Time.now())), PERIOD)
        self.addCleanup(repeated.close)
        buffer = tf2_ros.Buffer()
        tf2_ros.TransformListener(buffer)
        wait_for(
            lambda: buffer.can_transform("map", HAND, rospy.Time()), "the hand in map"
        )
        pelvis = buffer.lookup_transform("map", "pelvis", rospy.Time()).transform
        where = pelvis.translation
        self.assertEqual((where.x, where.y, where.z), (1.0, 2.0, 0.793))
