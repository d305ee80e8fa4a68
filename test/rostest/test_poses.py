"""Poses as a user types them: at launch, in a jump, smoothly, saved."""

import os
import shutil
import subprocess
import tempfile
import unittest
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from unittest import mock

import numpy as np
import rospy
import yaml
from g1_description.srv import GetAnchor, SetAnchor
from gazebo_msgs.msg import LinkStates
from gazebo_msgs.srv import DeleteModel, GetJointProperties
from sensor_msgs.msg import JointState
from std_srvs.srv import Empty
from support.pose_command import KNEE, POSES, run, start
from support.programs import Program
from support.ros_testing import (
    DEADLINE,
    PROFILE,
    REPOSITORY,
    Connected,
    Listener,
    Repeated,
    position_of,
    program,
    wait_for,
)

from g1_description.cli import pose
from g1_description.cli.pose import PosedRobot
from g1_description.ros.waiting import NoAnswerError

ANCHOR = "right_ankle_roll_link"


def is_in(name):
    """Make what tells whether joint states show a pose of the package."""

    def accept(message):
        return all(
            abs(position - POSES[name].get(joint, 0.0)) < 1e-9
            for joint, position in zip(message.name, message.position)
        )

    return accept


def call(service):
    rospy.wait_for_service(service, DEADLINE)
    rospy.ServiceProxy(service, Empty)()


def anchor_of(model):
    """Ask the simulator for the anchor of a model."""
    return rospy.ServiceProxy("/gazebo/get_anchor", GetAnchor)(model).link_name


class TestPoses(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        links = Listener("/gazebo/link_states", LinkStates)
        cls.states = Connected("/joint_states", JointState)
        cls.addClassCleanup(cls.states.close)
        wait_for(lambda: len(links.messages) > 50, "fifty link states")
        links.close()
        cls.states.wait()
        cls.first_links, cls.first_states = links.messages[:50], cls.states.messages
        cls.commands = rospy.Publisher("/joint_commands", JointState, queue_size=10)
        wait_for(cls.commands.get_num_connections, "the bridge to listen")
        rospy.wait_for_service("/set_anchor", DEADLINE)
        cls.anchor = anchor_of("g1_robot")
        rospy.ServiceProxy("/set_anchor", SetAnchor)(link_name="")

    @classmethod
    def tearDownClass(cls):
        """Let the robot be as it was launched."""
        call("/gazebo/reset_simulation")
        cls.states.clear()
        cls.states.wait(is_in("stand"), "the first pose")

    def put(self, name):
        """Put the robot into a pose of the package, without the command."""
        names = self.states.wait().name
        positions = [POSES[name].get(joint, 0.0) for joint in names]
        self.commands.publish(JointState(name=names, position=positions))
        self.assert_shown(name)

    def assert_shown(self, name):
        self.states.clear()
        self.states.wait(is_in(name), f"the pose {name}")

    def test_the_robot_begins_in_its_pose_on_the_floor(self):
        self.assertTrue(all(map(is_in("stand"), self.first_states)))
        row = self.first_links[0].name.index("g1_robot::pelvis")
        heights = {message.pose[row].position.z for message in self.first_links}
        self.assertEqual(heights, {0.764})

    def test_the_robot_begins_with_its_anchor(self):
        self.assertEqual(self.anchor, ANCHOR)

    def test_a_joint_that_cannot_be_at_zero_begins_at_its_nearest_limit(self):
        home = Path(tempfile.mkdtemp())
        self.addCleanup(shutil.rmtree, str(home))
        (home / "g1_description").mkdir()
        (home / "g1_description" / "poses.yaml").write_text("low: {}")
        robot = REPOSITORY / "test" / "data" / "range_2_8.urdf"
        rospy.set_param("/ranged", robot.read_text())
        asked = "_robot_description:=/ranged _model_name:=ranged _initial_pose:=low"
        asked += " _anchor:=arm"
        spawner = subprocess.run(
            [program("spawn_robot.py"), *asked.split()],
            env={**os.environ, "ROS_HOME": str(home)},
            check=False,
            timeout=DEADLINE,
        )
        delete = rospy.ServiceProxy("/gazebo/delete_model", DeleteModel)
        self.addCleanup(delete, "ranged")
        self.assertEqual(spawner.returncode, 0)
        joint = rospy.ServiceProxy("/gazebo/get_joint_properties", GetJointProperties)
        self.assertEqual(joint("ranged::turn").position, (2.0,))
        self.assertEqual(anchor_of("ranged"), "arm")

    def test_a_jump_is_there_when_the_command_ends_also_while_time_stands_still(self):
        for name, act in (("squat", "unpause_physics"), ("wave", "pause_physics")):
            call(f"/gazebo/{act}")
            self.addCleanup(call, "/gazebo/unpause_physics")
            self.states.clear()
            self.assertEqual(run(name), (0, f"pose: {name}\n", ""))
            self.states.wait(is_in(name), f"the pose {name}")

    def test_a_smooth_way_takes_its_time_and_never_turns_back(self):
        self.put("zero")
        self.states.clear()
        self.assertEqual(run("squat", "--seconds", 1), (0, "pose: squat\n", ""))
        self.states.wait(is_in("squat"), "the squat")
        seen = [*self.states.messages]
        knees = [round(position_of(message, KNEE), 9) for message in seen]
        self.assertEqual(knees, sorted(knees))
        # By the time between: a busy machine may skip some states.
        stamps = np.array([message.header.stamp.to_sec() for message in seen])
        speeds = np.diff(knees) / np.diff(stamps)
        self.assertLess(speeds.max(), 5.0)
        on_its_way = stamps[[0.0 < knee < 2.35 - 1e-9 for knee in knees]]
        self.assertLess(np.ptp(on_its_way), 1.3)

    def test_a_saved_pose_is_listed_and_taken_again(self):
        home = Path(tempfile.mkdtemp())
        self.addCleanup(shutil.rmtree, str(home))
        file = home / "g1_description" / "poses.yaml"
        self.put("wave")
        code, output, _ = run("--save", "mine", "--about", "my own", home=home)
        self.assertEqual((code, output), (0, f"pose: mine saved in {file}\n"))
        saved = yaml.safe_load(file.read_text())["mine"]
        self.assertEqual(saved.pop("about"), "my own")
        wanted = {joint: v for joint, v in POSES["wave"].items() if joint != "about"}
        self.assertEqual(saved, wanted)
        _, output, _ = run("--list", home=home)
        self.assertIn("\nmine      my own\n", output)
        self.assertEqual(len(output.splitlines()), len(POSES) + 1)
        self.put("zero")
        self.assertEqual(run("mine", home=home)[0], 0)
        self.assert_shown("wave")

    def test_nothing_is_overwritten_unasked_nor_written_into_the_package(self):
        home = Path(tempfile.mkdtemp())
        self.addCleanup(shutil.rmtree, str(home))
        file, own = (
            home / "mine.yaml",
            PROFILE / "poses.yaml",
        )
        file.write_text("mine: {}  # kept\n")
        before = own.read_text()
        code, _, errors = run("--save", "mine", "--file", file)
        self.assertEqual(code, 2)
        self.assertIn("The pose 'mine' already exists in ", errors)
        self.assertEqual(len(errors.splitlines()), 1)
        self.assertIn("belongs to the package", run("--save", "new", "--file", own)[2])
        self.assertEqual(own.read_text(), before)
        self.assertEqual(file.read_text(), "mine: {}  # kept\n")
        self.put("squat")
        self.assertEqual(run("--save", "stand", "--force", "--file", file)[0], 0)
        self.put("zero")
        self.assertEqual(run("stand", "--file", file)[0], 0)
        self.assert_shown("squat")

    def test_what_is_wrong_is_told_in_a_sentence_and_moves_nothing(self):
        self.put("zero")
        for words, told in (
            (["sqaut"], "Unknown pose 'sqaut'. Known poses: squat, "),
            (["squat", "--file", "/no/file"], "/no/file cannot be read: No such file"),
        ):
            code, output, errors = run(*words)
            self.assertEqual((code, output), (2, ""), words)
            self.assertIn(told, errors)
            self.assertEqual(len(errors.splitlines()), 1, errors)
        self.assert_shown("zero")

    def test_a_pose_of_another_robot_is_refused(self):
        self.put("zero")
        with tempfile.NamedTemporaryFile("w", suffix=".yaml") as file:
            file.write("odd: {left_kne_joint: 0.1}\n")
            file.flush()
            code, _, errors = run("odd", "--file", file.name)
        self.assertEqual(code, 2)
        told = "no movable joint 'left_kne_joint'. Its joints: left_knee_joint"
        self.assertIn(told, errors)
        self.assert_shown("zero")

    def test_a_way_halts_while_time_does(self):
        self.put("zero")
        self.states.clear()
        process = start("squat", "--seconds", 3)
        self.addCleanup(process.kill)
        self.states.wait(lambda m: position_of(m, KNEE) > 0.01, "the first steps")
        call("/gazebo/pause_physics")
        self.addCleanup(call, "/gazebo/unpause_physics")
        told = process.stdout.readline()
        self.assertRegex(told, "^pose: waiting: .*(time stands still|is time paused)")
        self.assertIsNone(process.poll())
        call("/gazebo/unpause_physics")
        output, _ = process.communicate()
        self.assertEqual((process.returncode, output), (0, "pose: squat\n"))
        self.assert_shown("squat")

    def test_a_reset_brings_the_first_pose_back(self):
        self.put("squat")
        call("/gazebo/reset_simulation")
        self.assert_shown("stand")

    def test_several_robots_have_namespaces(self):
        """A second bridge, which sees the robot under another namespace."""
        robots = "_robots:=[{name: g1_robot, namespace: left}]"
        bridge = Program("link_states_bridge.py", "__name:=second", robots)
        self.addCleanup(bridge.wait)
        self.addCleanup(bridge.terminate)
        listener = Listener("/left/joint_states", JointState)
        listener.wait()
        listener.close()
        self.put("zero")
        self.assertEqual(run("squat", "--namespace", "/left"), (0, "pose: squat\n", ""))
        self.assert_shown("squat")

    def test_what_does_not_happen_is_told(self):
        """No states, no obedience, no bridge."""
        still = JointState(name=self.states.wait().name, position=[0.0] * 29)
        still.header.stamp = rospy.Time(7)
        deaf = rospy.Publisher("/deaf/joint_states", JointState, queue_size=1)
        for closed in (
            Listener("/silent/joint_commands", JointState),
            Listener("/deaf/joint_commands", JointState),
            Repeated(lambda: deaf.publish(still), 0.02),
        ):
            self.addCleanup(closed.close)

        def end(space):
            """Give how it ends, and what is said before."""
            notes = []
            robot = PosedRobot(space, notes.append)
            with self.assertRaises(NoAnswerError) as told:
                robot.teleport(np.ones(29))
            return str(told.exception), notes

        with mock.patch.object(pose, "TIMEOUT", 3.0), ThreadPoolExecutor() as pool:
            silent, deaf_one, nobody = pool.map(end, ("silent", "deaf", "nobody"))
        quiet = "no messages on /silent/joint_states; is a simulator running"
        self.assertIn(f"The command was sent, but {quiet}", silent[0])
        self.assertIn(f"waiting: {quiet}", silent[1][0])
        self.assertIn("The robot did not reach the goal within 3 s: ", deaf_one[0])
        self.assertIn("simulated time stands still at 7 s", deaf_one[1][0])
        self.assertIn("Nothing subscribes to /nobody/joint_commands", nobody[0])
