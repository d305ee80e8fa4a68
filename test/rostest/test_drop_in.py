"""Launch files written for Gazebo run on the stand-in.

The one of someone else is unedited but for the RViz node, where there is no screen.
"""

import os
import shutil
import signal
import subprocess
import sys
import tempfile
import unittest
import uuid
from contextlib import closing
from itertools import chain
from pathlib import Path
from xml.etree import ElementTree

import numpy as np
import rospy
import tf2_ros
from gazebo_msgs.msg import ModelStates
from gazebo_msgs.srv import (
    GetJointProperties,
    GetModelState,
    GetPhysicsProperties,
    GetWorldProperties,
)
from pages import blocks
from rosgraph_msgs.msg import Clock
from scipy.spatial.transform import Rotation
from sensor_msgs.msg import JointState
from std_srvs.srv import Empty
from support.ros_testing import (
    DEADLINE,
    REPOSITORY,
    SHARED,
    Listener,
    Repeated,
    position_of,
    process_of,
    wait_for,
)
from support.stamp_record import Others, Record, splits
from support.virtual_screen import VirtualScreen

from processes import end_processes, marked_environment, marked_processes, wait_for_end

LAUNCH = SHARED / "clients" / "display_and_gazebo_original.launch"
NODE = SHARED / "clients" / "link_states_bridge_original.py"
CLOCK = Path(__file__).resolve().parent / "support" / "gazebo_clock.py"
CLIENTS = """<package format="2"><name>clients</name><version>0.0.0</version>
<description>d</description><maintainer email='a@b.c'>m</maintainer>
<license>none</license></package>"""
GAZEBO_ROS = CLIENTS.replace("clients", "gazebo_ros")
EMPTY_WORLD = """<launch>
  <arg name="paused"/><arg name="use_sim_time"/><arg name="gui"/>
  <arg name="respawn_gazebo"/>
  <arg name="use_clock_frequency" default="false"/>
  <arg name="pub_clock_frequency" default="100"/>
  <group if="$(arg use_clock_frequency)">
    <param name="gazebo/pub_clock_frequency" value="$(arg pub_clock_frequency)"/>
  </group>
  <node name="gazebo" pkg="g1_description" type="gazebo_stand_in.py">
    <remap from="/clock" to="/stepped_clock"/>
    <remap from="~simulator_state" to="/no_simulator_state"/>
    <param name="link_states_rate" value="0"/>
  </node>
  <node name="gazebo_clock" pkg="gazebo_ros" type="gazebo_clock.py"/>
</launch>"""
"""gazebo_ros' launch file with a node that behaves as Gazebo: its /clock is limited as
there, link_states come with each step, and there is no simulator_state."""
FOREIGN = {"map", "pelvis", "body_imu"}
"""Frames of the launch file's own static_transform_publishers: one of their messages
may be on its way when the time is reset."""
PATIENCE = 120.0
"""How long roslaunch waits for the end of a node before it kills it, in [s]: by itself
15, which is not enough on a busy machine."""


class TestDropIn(unittest.TestCase):
    def setUp(self):
        self.folder = Path(tempfile.mkdtemp(prefix="drop_in_"))
        self.addCleanup(shutil.rmtree, self.folder)
        self.models = Listener("/gazebo/model_states", ModelStates)
        self.states = Listener("/joint_states", JointState)
        self.addCleanup(self.states.close)
        self.addCleanup(self.models.close)

    def copy(self, node=None):
        """Copy the launch file; a node may stand in for the bridge."""
        tree = ElementTree.parse(LAUNCH)
        root = tree.getroot()
        for element in root.findall("node"):
            if element.get("name") == "rviz" and not os.environ.get("DISPLAY"):
                root.remove(element)
            if element.get("name") == "link_states_bridge" and node:
                element.set("pkg", "clients")
                package = self.folder / "clients"
                package.mkdir()
                (package / "package.xml").write_text(CLIENTS)
                program = package / element.get("type")
                shutil.copy(node, program)
                program.chmod(0o755)
        tree.write(self.folder / "display_and_gazebo.launch")
        return self.folder / "display_and_gazebo.launch"

    def launch(self, *arguments, **environment):
        """Launch in this master, with a mark on every process."""
        self.mark = f"DROP_IN_RUN={uuid.uuid4().hex}"
        environment = {**marked_environment(self.mark), **environment}
        environment["ROS_PACKAGE_PATH"] += f":{self.folder}"
        # For nodes that are not installed: the Python that has rospy.
        environment["PATH"] = f"{Path(sys.executable).parent}:{environment['PATH']}"
        self.log = self.folder / "roslaunch.txt"
        with self.log.open("w") as output:
            self.roslaunch = subprocess.Popen(
                [
                    *("roslaunch", "--wait", f"--sigint-timeout={PATIENCE}"),
                    *map(str, arguments),
                ],
                env=environment,
                stdout=output,
                stderr=subprocess.STDOUT,
                start_new_session=True,
            )
        self.addCleanup(self.roslaunch.wait)
        self.addCleanup(end_processes, self.mark)

    def check_that_it_runs(self, height):
        """Spawned at this height, measured, commanded; then it falls: no motors."""
        spawned = self.models.wait(lambda m: "g1_robot" in m.name, "the robot")
        # By the time of the first message that comes it may have begun to fall.
        self.assertAlmostEqual(self.height(spawned), height, delta=0.05)
        self.check_that_it_moves()

    def check_that_it_moves(self):
        """Measured, commanded; then it falls."""
        self.assertEqual(len(self.states.wait().name), 29)
        self.check_the_frames()
        self.check_a_command()
        self.models.clear()
        self.models.wait(lambda m: self.height(m) < 0.4, "the fall")
        self.models.close()

    def check_the_frames(self):
        buffer = tf2_ros.Buffer()
        listener = tf2_ros.TransformListener(buffer)
        for child in ("base_link", "left_wrist_yaw_link"):
            wait_for(
                lambda child=child: buffer.can_transform("map", child, rospy.Time()),
                f"map -> {child}",
            )
        listener.unregister()

    def check_a_command(self):
        commands = rospy.Publisher("/joint_commands", JointState, queue_size=1)
        wait_for(commands.get_num_connections, "the bridge to listen")
        self.states.clear()
        command = JointState(name=["left_elbow_joint"], position=[2.0])
        # Without motors the joint may be elsewhere by the next state.
        with closing(Repeated(lambda: commands.publish(command), 0.05)):
            self.states.wait(
                lambda m: abs(position_of(m, "left_elbow_joint") - 2.0) < 0.2,
                "the elbow at 2",
            )
        commands.unregister()

    def check_that_stamps_rise(self):
        """Through a reset, after which TF goes on, and nobody complains."""
        record, others = Record(), Others()
        self.addCleanup(record.close)
        self.addCleanup(others.close)
        self.wait_for_simulated(0.5)
        rospy.ServiceProxy("/gazebo/reset_simulation", Empty)()
        wait_for(lambda: len(splits(record.frames()["base_link"])) == 2, "TF to go on")
        self.wait_for_simulated(0.5)
        self.assertGreater(len(record.joints()), 50)
        self.assertEqual(record.not_rising(), {})
        told = [*chain(*others.trouble().values()), *record.trouble()]
        self.assertEqual([pair for pair in told if pair[0] not in FOREIGN], [])

    def wait_for_simulated(self, seconds):
        """Let simulated time pass, by the stamps of joint states."""
        self.states.clear()
        end = self.states.wait().header.stamp + rospy.Duration(seconds)
        what = f"{seconds} s"
        self.states.wait(lambda m: m.header.stamp > end, what)

    @staticmethod
    def height(message):
        """Give the robot's height of model states in [m]."""
        return message.pose[message.name.index("g1_robot")].position.z

    def check_that_it_ends(self):
        """On Ctrl-C, with every process gone and none killed."""
        self.roslaunch.send_signal(signal.SIGINT)
        wait_for_end(self.mark, DEADLINE)
        self.assertEqual(marked_processes(self.mark), {})
        self.assertEqual(self.roslaunch.wait(), 0)
        for words in ("has died", "escalating"):
            self.assertNotIn(words, self.log.read_text())

    @unittest.skipUnless(LAUNCH.exists(), f"{LAUNCH.name} is not there")
    def test_the_launch_file_of_someone_else_with_our_bridge(self):
        self.launch(self.copy())
        self.check_that_it_runs(0.79)
        self.assertEqual(len(self.states.wait().effort), 0)
        self.check_that_stamps_rise()
        self.check_that_it_ends()
        self.assertNotIn("Traceback", self.log.read_text())

    @unittest.skipUnless(LAUNCH.exists(), f"{LAUNCH.name} is not there")
    @unittest.skipUnless(NODE.exists(), f"{NODE.name} is not there")
    @unittest.skipUnless(hasattr(Rotation, "magnitude"), "that node needs scipy 1.4")
    def test_the_launch_file_of_someone_else_with_its_own_node(self):
        self.launch(self.copy(NODE))
        self.check_that_it_runs(0.79)
        self.assertEqual(len(self.states.wait().effort), 29)
        self.check_that_it_ends()

    def test_the_launch_file_of_the_tutorial(self):
        page = REPOSITORY / "docs" / "tutorials" / "from_gazebo.md"
        (text,) = blocks(page.read_text(encoding="utf-8"), "xml")
        file = self.folder / "my_gazebo.launch"
        file.write_text(text)
        self.launch(file)
        self.check_that_it_runs(0.793)
        self.check_that_it_ends()

    def launch_gazebo(self, empty_world, *arguments):
        """Launch our display with gazebo_ros, of which this is the launch file."""
        package = self.folder / "gazebo_ros"
        (package / "launch").mkdir(parents=True)
        (package / "package.xml").write_text(GAZEBO_ROS)
        (package / "launch" / "empty_world.launch").write_text(empty_world)
        shutil.copy(CLOCK, package)
        self.launch(
            *("g1_description", "display.launch", "sim:=gazebo", "rviz:=false"),
            *arguments,
            ROS_PACKAGE_PATH=f"{self.folder}:{os.environ['ROS_PACKAGE_PATH']}",
        )

    def test_our_display_with_gazebo_ros_whose_robot_comes_back_with_it(self):
        """At the place and in the pose of the launch file, if that was asked."""
        own = REPOSITORY / "interfaces" / "gazebo_ros" / "launch" / "empty_world.launch"
        self.launch_gazebo(
            own.read_text(),
            *("respawn_gazebo:=true", "gui:=false", "paused:=true"),
            *("x:=1", "Y:=0.5", "initial_pose:=stand"),
        )
        wait_for(self.is_in_place, "the robot")
        pid = process_of("/gazebo")
        os.kill(pid, signal.SIGKILL)
        wait_for(lambda: process_of("/gazebo") not in (None, pid), "a new simulator")
        wait_for(self.is_in_place, "the robot in it")
        self.assertEqual(rospy.get_param("/gazebo/sim"), "gazebo")
        name = "/gazebo/get_physics_properties"
        self.assertTrue(rospy.ServiceProxy(name, GetPhysicsProperties)().pause)
        rospy.ServiceProxy("/gazebo/unpause_physics", Empty)()
        self.check_that_it_moves()
        self.roslaunch.send_signal(signal.SIGINT)
        wait_for_end(self.mark, DEADLINE)
        self.assertEqual(marked_processes(self.mark), {})
        self.assertNotIn("Traceback", self.log.read_text())

    def is_in_place(self):
        """Look whether the robot stands on the floor where that test wants it."""
        state = rospy.ServiceProxy("/gazebo/get_model_state", GetModelState)
        joint = rospy.ServiceProxy("/gazebo/get_joint_properties", GetJointProperties)
        try:
            pose = state("g1_robot", "").pose
            knee = joint("left_knee_joint")
        except rospy.ServiceException:
            return False
        there = pose.position.x, pose.orientation.z, *knee.position
        wanted = 1.0, np.sin(0.25), 0.6
        is_there = len(there) == len(wanted) and np.allclose(there, wanted)
        return is_there and 0.7 < pose.position.z < 0.79

    def test_a_clock_like_gazebos_goes_on_after_a_reset(self):
        """Even where a display of the stand-in has left its rate behind."""
        rospy.set_param("/gazebo/pub_clock_frequency", 200.0)
        self.addCleanup(rospy.delete_param, "/gazebo/pub_clock_frequency")
        self.launch_gazebo(EMPTY_WORLD)
        self.wait_for_simulated(1.0)
        states, clock = self.states.messages[-100:], Listener("/clock", Clock)
        self.addCleanup(clock.close)
        stamps = [message.header.stamp.to_nsec() for message in states]
        self.assertGreaterEqual(min(np.diff(stamps)), 5_000_000)
        clock.wait()
        rospy.ServiceProxy("/gazebo/reset_simulation", Empty)()
        clock.wait(lambda m: m.clock.to_sec() < 1.0, "the time after the reset")
        self.states.wait(lambda m: m.header.stamp.to_sec() < 1.0, "states after it")
        self.check_that_it_ends()

    def test_a_required_server_takes_everything_with_it(self):
        """A parameter of a launch file, a wrong one, wins over the command line."""
        file = self.folder / "magic.launch"
        file.write_text(
            """<launch>
              <include file="$(find gazebo_ros)/launch/empty_world.launch">
                <arg name="gui" value="true"/>
                <arg name="server_required" value="true"/>
                <arg name="physics" value="hold"/>
              </include>
              <param name="/gazebo/physics" value="magic"/>
            </launch>"""
        )
        self.addCleanup(rospy.delete_param, "/gazebo/physics")
        self.launch(file)
        self.roslaunch.wait(DEADLINE)
        wait_for_end(self.mark, DEADLINE)
        self.assertEqual(marked_processes(self.mark), {})
        self.assertRegex(self.log.read_text(), r"\[FATAL\].*magic")

    def test_the_window_is_rviz_and_what_means_nothing_is_told_once(self):
        """What an earlier launch left does not come back: robot, physics, pause."""
        left = {"robot_description": "robot_description", "physics": "magic"}
        for name, value in {**left, "paused": True}.items():
            rospy.set_param(f"/gazebo/{name}", value)
        screen = VirtualScreen(640, 480)
        self.addCleanup(screen.stop)
        options = ("recording:=true", "headless:=true", "extra_gazebo_args:=--seed 3")
        launch = ("gazebo_ros", "empty_world.launch", *options)
        self.launch(*launch, DISPLAY=screen.display)
        pid = wait_for(lambda: process_of("/gazebo_gui"), "the window")
        command = Path(f"/proc/{pid}/cmdline").read_text().split("\0")
        self.assertEqual(command[:2], ["rviz", "-d"])
        self.assertTrue(command[2].endswith("/rviz/g1.rviz"), command[2])
        world = rospy.ServiceProxy("/gazebo/get_world_properties", GetWorldProperties)
        world.wait_for_service(DEADLINE)
        self.assertEqual(world().model_names, ["ground_plane"])
        self.assertFalse(rospy.has_param("/gazebo/paused"))
        self.check_that_it_ends()
        told = "Ignored gzserver options: -r, --headless, --seed."
        self.assertEqual(self.log.read_text().count(told), 1)
