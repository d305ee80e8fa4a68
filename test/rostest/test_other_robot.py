"""The display of another robot, with a profile of its own.

Those of public packages are in test/web/test_other_robots.py.
"""

import shutil
import tempfile
import unittest
from pathlib import Path

import rospy
from g1_description.srv import CheckState
from gazebo_msgs.msg import LinkStates
from geometry_msgs.msg import Pose
from sensor_msgs.msg import JointState
from support.pose_command import POSES, run
from support.ros_testing import (
    REPOSITORY,
    Connected,
    Launch,
    service,
)
from tf2_msgs.msg import TFMessage

from g1_description.robot.urdf import parse_urdf
from g1_description.ros.parameters import parse_robot, read_robot

from page_client import PageClient
from ports import free_port

G1 = parse_urdf((REPOSITORY / "urdf" / "g1_29dof.urdf").read_text())
ITS_NAMES = {*G1.link_names, *(joint.name for joint in G1.joints), *POSES} - {"zero"}
STRIDER = REPOSITORY / "test" / "data" / "five_links.urdf"


class TestRobotWithAProfile(unittest.TestCase):
    """Display, motors, checks and page."""

    poses = ("zero", "low")

    @classmethod
    def setUpClass(cls):
        cls.folder = folder = tempfile.mkdtemp()
        cls.addClassCleanup(shutil.rmtree, folder)
        Path(folder, "robot.yaml").write_text(f"names: [strider]\nmodel: {STRIDER}\n")
        Path(folder, "poses.yaml").write_text("low: {l_hip: -0.1, r_hip: -0.1}\n")
        Path(folder, "motors.yaml").write_text("'.*_ankle': {effort: 12}\n")
        cls.port = free_port()
        switches = ("rviz:=false", "physics:=hold", "checks:=true", "web:=true")
        its_own = (f"robot:={folder}", "initial_pose:=low", f"port:={cls.port}")
        launch = Launch("display.launch", *switches, "rate:=50", *its_own)
        cls.addClassCleanup(launch.stop)
        cls.states = Connected("/joint_states", JointState)
        cls.robot = parse_urdf(rospy.get_param("/robot_description"))
        cls.names = [joint.name for joint in cls.robot.movable_joints]

    def test_0_it_begins_in_its_pose(self):
        position = dict(zip(self.states.wait().name, self.states.wait().position))
        self.assertAlmostEqual(position["l_hip"], -0.1, delta=0.02)

    def test_nodes_know_its_profile(self):
        """The simulator does as well, for a robot that another node spawns."""
        text = rospy.get_param("/robot_description")
        for robot in (read_robot("/robot_description"), parse_robot(text)):
            self.assertEqual(robot.profile.motors, Path(self.folder, "motors.yaml"))
        self.assertEqual(parse_robot(text.replace("sole_l", "sole")).profile.name, "")

    def test_its_joints_are_published_and_move(self):
        self.assertEqual(set(self.states.wait().name), set(self.names))
        code, _, errors = run(self.poses[-1], "--seconds", "0.5")
        self.assertEqual((code, errors), (0, ""))

    def test_its_poses_alone_are_listed(self):
        code, output, errors = run("--list")
        self.assertEqual((code, errors), (0, ""))
        names = tuple(line.split()[0] for line in output.splitlines())
        self.assertEqual(names, self.poses)
        code, _, errors = run("t_pose")
        self.assertEqual(code, 2)
        self.assertIn("Unknown pose 't_pose'. Known poses: ", errors)

    def test_its_frames_alone_are_in_tf(self):
        static = Connected("/tf_static", TFMessage)
        static.wait(
            lambda message: any(
                (edge.header.frame_id, edge.child_frame_id)
                == ("base_link", self.robot.root)
                for edge in message.transforms
            ),
            "the root",
        )
        found = {e.child_frame_id for m in static.messages for e in m.transforms}
        self.assertFalse(found & (ITS_NAMES | {"body_imu"}))
        static.close()

    def test_it_is_checked_by_its_own_links(self):
        check = service("/checker/check_state", CheckState)
        joints = JointState(name=self.names, position=[0.0] * len(self.names))
        answer = check(joints, False, Pose(), ["self_collision"])
        self.assertEqual((answer.success, answer.valid), (True, True), answer)
        self.assertEqual(answer.checked, ["self_collision"])

    def test_its_page_has_its_joints_and_poses(self):
        with PageClient(f"http://127.0.0.1:{self.port}") as client:
            client.wait_until_whole()
            self.assertEqual(tuple(client.element("Go to pose")["options"]), self.poses)
            words = {w for e in [*client.elements.values()] for w in str(e).split("'")}
        self.assertFalse(words & ITS_NAMES)
        self.assertLessEqual({n.replace("_joint", "") for n in self.names}, words)


class TestG1(unittest.TestCase):
    """Another G1 of the package stands on the floor, and is checked."""

    def test_a_profile_is_enough(self):
        name = "g1_23dof"
        switches = ("rviz:=false", "checks:=true", "initial_pose:=stand")
        launch = Launch("display.launch", f"robot:={name}", *switches)
        self.addCleanup(launch.stop)
        links = Connected("/gazebo/link_states", LinkStates)
        self.addCleanup(links.close)
        joints = Connected("/joint_states", JointState)
        self.addCleanup(joints.close)
        state, configuration = links.wait(), joints.wait()
        robot = read_robot("/robot_description")
        self.assertEqual((robot.name, robot.profile.name), (name, name))
        self.assertEqual(len(configuration.name), 23)
        base = state.pose[state.name.index("g1_robot::pelvis")]
        self.assertAlmostEqual(base.position.z, 0.764, delta=1e-3)
        check = service("/checker/check_state", CheckState)
        answer = check(configuration, True, base, [])
        self.assertEqual((answer.success, answer.valid), (True, True))
