"""Two robots of one launch file: side by side on the floor, and so in RViz."""

import unittest

import rospy
import tf2_ros
from sensor_msgs.msg import JointState
from support.ros_testing import Connected, position_of, wait_for
from support.rviz_window import RvizWindow, dark, extent, is_calm, length, view_of

PLACES = {"left": 0.7, "right": -0.7}
"""[m] along y."""
ELBOW = "left_elbow_joint"


class TestTwoRobots(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.window = RvizWindow(
            "two_robots.rviz", "two_robots.launch", "gui:=false", "rate:=50"
        )
        cls.addClassCleanup(cls.window.close)
        cls.buffer = tf2_ros.Buffer()
        cls.transforms = tf2_ros.TransformListener(cls.buffer)

    def place(self, frame):
        """Give a frame's place in the map; nothing if it is not known."""
        try:
            found = self.buffer.lookup_transform("map", frame, rospy.Time())
        except tf2_ros.TransformException:
            return None
        where = found.transform.translation
        return [round(number, 6) for number in (where.x, where.y, where.z)]

    def test_both_stand_on_the_floor_side_by_side(self):
        for name, y in PLACES.items():
            wait_for(
                lambda name=name, y=y: self.place(f"{name}/pelvis") == [0, y, 0.793],
                f"the {name} robot at y = {y}",
            )
            wait_for(lambda name=name: self.place(f"{name}/head_link"), "its head")

    def test_each_has_its_own_joints(self):
        states = {
            name: Connected(f"/{name}/joint_states", JointState) for name in PLACES
        }
        commands = rospy.Publisher("/left/joint_commands", JointState, queue_size=1)
        wait_for(commands.get_num_connections, "the bridge to listen")
        commands.publish(JointState(name=[ELBOW], position=[0.5]))

        def is_at(position):
            return lambda m: abs(position_of(m, ELBOW) - position) < 1e-12

        states["left"].wait(is_at(0.5), "a bent elbow")
        states["right"].clear()
        self.assertTrue(is_at(0.0)(states["right"].wait()))

    def test_rviz_shows_one_left_and_one_right(self):
        def shows_both(picture):
            if not is_calm(picture):
                return False
            seen = dark(picture[view_of(picture)])
            height, width = seen.shape
            halves = seen[:, : width // 2], seen[:, width // 2 :]
            between = seen[:, int(0.45 * width) : int(0.55 * width)]
            whole = [length(extent(half)[0]) > 0.4 * height for half in halves]
            return all(whole) and not between.any()

        self.window.picture_when(shows_both, "two robots side by side")
