#!/usr/bin/env python3
"""RViz shows the robot: whole, upright, in its colours, and as its joints stand.

Parameters: ~model: URDF file, as seen from the repository
    ~rviz: arguments of rviz.launch
    ~pictures: folder for the pictures; otherwise only a failure leaves one
"""

import os
import sys
import tempfile
import threading
import unittest
from pathlib import Path
from unittest import mock

import numpy as np
import rospkg
import rospy
import rostest
from gazebo_msgs.msg import ModelState
from gazebo_msgs.srv import SetModelState
from geometry_msgs.msg import Point, Pose, Quaternion
from ros_testing import REPOSITORY, SHARED, Launch, Listener, wait_for
from rosgraph_msgs.msg import Log
from sensor_msgs.msg import JointState
from virtual_screen import VirtualScreen, write_png

DEADLINE = 60.0
BACKGROUND = (96, 106, 116)
COMPLAINTS = ((192, 32, 32), (192, 128, 0))
"""In which RViz writes the names of displays with errors, with warnings."""
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


def different(a, b):
    """Mark the pixels, shape (height, width), that clearly differ."""
    return np.abs(a.astype(int) - b).max(axis=2) > 10


def extent(mask):
    """Give the smallest slices of rows and columns that hold all that is marked."""
    rows, columns = (np.flatnonzero(mask.any(axis=axis)) for axis in (1, 0))
    return tuple(
        slice(i[0], i[-1] + 1) if i.size else slice(0, 0) for i in (rows, columns)
    )


def length(part):
    return part.stop - part.start


def view_of(picture):
    """Find the 3D view in a picture of the whole window.

    It is where rows and columns have much of its background; the panel that tells
    this colour has a bit of it as well.
    """
    mask = (picture == BACKGROUND).all(axis=2)
    much = [mask.sum(axis=axis, keepdims=True) > 100 for axis in (1, 0)]
    return extent(mask & much[0] & much[1])


def complaints_in(picture):
    """Count the pixels in colours that RViz has for errors and warnings only."""
    return sum((picture == colour).all(axis=2).sum() for colour in COMPLAINTS)


class TestRvizPicture(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        """Open RViz while the robot is out of its view."""
        cls.log = Listener("/rosout", Log)
        cls.commands = rospy.Publisher("/joint_commands", JointState, queue_size=1)
        cls.launch("display.launch", "rviz:=false", f"model:={model()}")
        wait_for(cls.commands.get_num_connections, "the bridge to listen", DEADLINE)
        rospy.wait_for_service("/gazebo/set_model_state", DEADLINE)
        cls.set_model_state = rospy.ServiceProxy(
            "/gazebo/set_model_state", SetModelState
        )
        cls.lift(OUT_OF_VIEW)

        cls.screen = VirtualScreen(1200, 900)
        cls.addClassCleanup(cls.screen.stop)
        home = tempfile.TemporaryDirectory()  # RViz leaves its settings there
        cls.addClassCleanup(home.cleanup)
        environment = {
            "DISPLAY": cls.screen.display,
            "HOME": home.name,
            "LIBGL_ALWAYS_SOFTWARE": "1",
            "ROS_LOG_DIR": rospkg.get_log_dir(),
            "XDG_RUNTIME_DIR": home.name,
        }
        with mock.patch.dict(os.environ, environment):
            cls.launch("rviz.launch", *rospy.get_param("~rviz", "").split())
        cls.view = None
        cls.empty = cls.picture_when(
            cls.is_empty_view, "an empty view without complaints"
        )
        cls.view = view_of(cls.empty)

    @classmethod
    def launch(cls, *arguments):
        cls.addClassCleanup(Launch(*arguments).stop)

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

    @classmethod
    def picture_when(cls, condition, what):
        """Wait for a picture that fulfils a condition and has come to rest."""
        pause = threading.Event()
        last = cls.screen.picture()

        def fulfilled():
            nonlocal last
            before = last
            pause.wait(0.3)
            last = cls.screen.picture()
            at_rest = not different(before, last)[cls.view or view_of(last)].any()
            return at_rest and condition(last)

        folder, name = Path(rospkg.get_test_results_dir()), "rviz_failure"
        try:
            wait_for(fulfilled, f"a picture of {what}", DEADLINE)
            folder, name = rospy.get_param("~pictures", ""), what.replace(" ", "_")
        except AssertionError as error:
            raise AssertionError(f"{error}; see {name}.png in {folder}") from None
        finally:
            if folder:
                write_png(Path(folder) / f"{name}.png", last)
        return last

    @staticmethod
    def is_empty_view(picture):
        rows, columns = view_of(picture)
        large = length(rows) > 500 and length(columns) > 500
        return large and not complaints_in(picture)

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
        return self.picture_when(self.is_robot_standing, "the robot standing")

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
        stretched = self.picture_when(out, "arms stretched out")
        moved = different(hanging, stretched)[self.view]
        half = (rows.start + rows.stop) // 2
        self.assertGreater(moved[:half].sum(), 2000)
        self.assertFalse(moved[half:].any(), "more than the arms moved")

        self.move_arms(0)
        self.picture_when(
            lambda picture: not different(picture, hanging)[self.view].any(),
            "arms back",
        )

    def test_it_leaves_when_it_is_taken_away(self):
        self.stand()
        self.lift(OUT_OF_VIEW)
        self.picture_when(
            lambda picture: not self.silhouette(picture).any(), "the robot gone"
        )

    def test_rviz_complains_of_nothing(self):
        """Neither in the log nor in its panel, where it tells missing transforms."""
        self.stand()
        self.picture_when(lambda picture: not complaints_in(picture), "no complaint")
        self.log.wait(lambda message: message.name == "/rviz", "RViz's log")
        bad = [
            message.msg
            for message in self.log.messages
            if message.name == "/rviz" and message.level >= Log.ERROR
        ]
        self.assertEqual(bad, [])


if __name__ == "__main__":
    rospy.init_node("rviz_picture")
    absent = SHARED in model().parents and not model().exists()
    case = unittest.skipIf(absent, f"{model().name} of the vendor is not there")
    rostest.rosrun("g1_description", "rviz_picture", case(TestRvizPicture), sys.argv)
