"""RViz shows the robot: whole, upright, in its colours, and as its joints stand.

Parameters: ~model: URDF file, as seen from the repository
    ~rviz: arguments of rviz.launch
    ~pictures: folder for the pictures; otherwise only a failure leaves one
"""

import unittest

import numpy as np
import rospy
from gazebo_msgs.msg import ModelState
from gazebo_msgs.srv import SetModelState
from geometry_msgs.msg import Point, Pose, Quaternion
from rosgraph_msgs.msg import Log
from sensor_msgs.msg import JointState
from support.ros_testing import REPOSITORY, SHARED, Launch, Listener, wait_for
from support.rviz_window import (
    DEADLINE,
    RvizWindow,
    complaints_in,
    different,
    extent,
    is_calm,
    length,
    view_of,
)

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


def model():
    return (REPOSITORY / rospy.get_param("~model")).resolve()


class TestRvizPicture(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        """Open RViz while the robot is out of its view."""
        if SHARED in model().parents and not model().exists():
            raise unittest.SkipTest(f"{model().name} of the vendor is not there")
        cls.log = Listener("/rosout", Log)
        cls.commands = rospy.Publisher("/joint_commands", JointState, queue_size=1)
        arguments = "rviz:=false", "rate:=50", f"model:={model()}"
        display = Launch("display.launch", *arguments)
        cls.addClassCleanup(display.stop)
        wait_for(cls.commands.get_num_connections, "the bridge to listen", DEADLINE)
        rospy.wait_for_service("/gazebo/set_model_state", DEADLINE)
        cls.set_model_state = rospy.ServiceProxy(
            "/gazebo/set_model_state", SetModelState
        )
        cls.lift(OUT_OF_VIEW)

        arguments = rospy.get_param("~rviz", "").split()
        cls.window = RvizWindow("g1.rviz", "rviz.launch", *arguments)
        cls.addClassCleanup(cls.window.close)
        cls.empty = cls.window.picture_when(is_calm, "an empty view without complaints")
        cls.view = cls.window.view = view_of(cls.empty)

    @classmethod
    def lift(cls, height):
        """Set the pelvis upright above the origin."""
        pose = Pose(Point(0.0, 0.0, height), Quaternion(0.0, 0.0, 0.0, 1.0))
        answer = cls.set_model_state(ModelState(model_name="g1_robot", pose=pose))
        assert answer.success, answer.status_message

    @classmethod
    def move_arms(cls, which):
        """Let them hang (0) or stretch them out (1)."""
        positions = [positions[which] for positions in ARMS.values()]
        cls.commands.publish(JointState(name=list(ARMS), position=positions))

    def silhouette(self, picture):
        return different(picture, self.empty)[self.view]

    def is_robot_standing(self, picture):
        """Whether a whole robot fills the height and stands in the middle."""
        seen = self.silhouette(picture)
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

    def stand(self):
        self.lift(STANDING)
        self.move_arms(0)
        return self.window.picture_when(self.is_robot_standing, "the robot standing")

    def test_the_robot_is_seen_in_its_colours(self):
        picture = self.stand()
        robot = picture[self.view][self.silhouette(picture)].astype(int)
        brightness = robot.mean(axis=1)
        self.assertLess(np.percentile(np.ptp(robot, axis=1), 90), 15, "not grey")
        self.assertGreater((brightness > 125).mean(), 0.3, "hardly any white")
        self.assertGreater((brightness < 60).mean(), 0.05, "hardly anything dark")
        self.assertGreater(len(np.unique(robot, axis=0)), 30, "no light and shade")

    def test_arms_are_seen_to_move(self):
        """They come out on both sides, the legs stay, and all goes back."""
        hanging = self.stand()
        rows, columns = extent(self.silhouette(hanging))
        reach = 0.1 * length(rows)

        def out(picture):
            now = extent(self.silhouette(picture))[1]
            return now.start < columns.start - reach and now.stop > columns.stop + reach

        self.move_arms(1)
        stretched = self.window.picture_when(out, "arms stretched out")
        moved = different(hanging, stretched)[self.view]
        half = (rows.start + rows.stop) // 2
        self.assertGreater(moved[:half].sum(), 2000)
        self.assertFalse(moved[half:].any(), "more than the arms moved")

        self.move_arms(0)
        self.window.picture_when(
            lambda picture: not different(picture, hanging)[self.view].any(),
            "arms back",
        )

    def test_it_leaves_when_it_is_taken_away(self):
        self.stand()
        self.lift(OUT_OF_VIEW)
        self.window.picture_when(
            lambda picture: not self.silhouette(picture).any(), "the robot gone"
        )

    def test_rviz_complains_of_nothing(self):
        """Neither in the log nor in its panel, where it tells missing transforms."""
        self.stand()
        self.window.picture_when(
            lambda picture: not complaints_in(picture), "no complaint"
        )
        self.log.wait(lambda message: message.name == "/rviz", "RViz's log")
        bad = [
            message.msg
            for message in self.log.messages
            if message.name == "/rviz" and message.level >= Log.ERROR
        ]
        self.assertEqual(bad, [])
