"""While time stands still the robot can be looked at, by who comes late as well."""

import subprocess
import tempfile
import time
import unittest
from pathlib import Path

import rospy
import tf2_ros
from diagnostic_msgs.msg import DiagnosticArray
from gazebo_msgs.msg import LinkStates, ModelState, ModelStates
from gazebo_msgs.srv import GetWorldProperties
from rosgraph_msgs.msg import Clock, Log
from sensor_msgs.msg import JointState
from std_srvs.srv import Empty
from support.ros_testing import (
    DEADLINE,
    Connected,
    Launch,
    Listener,
    position_of,
    program,
    wait_for,
)

ELBOW = "left_elbow_joint"
RATE = 50
"""[Hz, simulated time] Of what the simulator publishes."""
A_WHILE = 3.0
"""So long nothing may be said of a pause, in [s] of wall time."""


class Paused(unittest.TestCase):
    arguments = ()

    @classmethod
    def setUpClass(cls):
        arguments = "rviz:=false", f"rate:={RATE}", *cls.arguments
        launch = Launch("display.launch", *arguments)
        cls.addClassCleanup(launch.stop)
        cls.log = Listener("/rosout", Log)
        cls.states = Listener("/joint_states", JointState)
        for listener in (cls.log, cls.states):
            cls.addClassCleanup(listener.close)
        cls.states.wait()
        cls.commands = rospy.Publisher("/joint_commands", JointState, queue_size=10)
        cls.addClassCleanup(cls.commands.unregister)
        wait_for(cls.commands.get_num_connections, "the bridge")

    def pause(self):
        rospy.wait_for_service("/gazebo/pause_physics", DEADLINE)
        rospy.ServiceProxy("/gazebo/pause_physics", Empty)()
        world = rospy.ServiceProxy("/gazebo/get_world_properties", GetWorldProperties)
        end = world().sim_time
        wait_for(lambda: abs(rospy.get_time() - end) < 1e-9, "the last /clock")
        # It is one period old at most.
        self.states.wait(
            lambda m: m.header.stamp.to_sec() > end - 1.02 / RATE,
            "the last joint states",
        )

    def command(self, position):
        self.commands.publish(JointState(name=[ELBOW], position=[position]))

    def check_that_commands_show(self):
        """Each in joint states and on TF, though time stands still."""
        for number in range(1, 6):
            self.check_that_a_command_shows(0.1 * number)

    def check_that_a_command_shows(self, position):
        buffer = tf2_ros.Buffer()
        listener = tf2_ros.TransformListener(buffer, tcp_nodelay=True)
        self.wait_for_frames(buffer)
        before = self.turn(buffer)
        self.command(position)
        self.states.wait(lambda m: abs(position_of(m, ELBOW) - position) < 1e-9, "it")
        wait_for(lambda: self.turn(buffer) != before, "the command on TF")
        listener.unregister()

    @staticmethod
    def turn(buffer):
        found = buffer.lookup_transform("map", "left_wrist_yaw_link", rospy.Time())
        return found.transform.rotation.y

    @staticmethod
    def wait_for_frames(buffer):
        wait_for(
            lambda: all(
                buffer.can_transform("map", link, rospy.Time())
                for link in ("left_wrist_yaw_link", "head_link")
            ),
            "the frames",
        )

    def check_that_it_can_be_seen(self):
        """Who comes now gets joint states and frames, and a picture."""
        late = subprocess.run(
            ["rostopic", "echo", "-n1", "/joint_states/name"],
            stdout=subprocess.PIPE,
            text=True,
            timeout=DEADLINE,
        )
        self.assertIn(ELBOW, late.stdout)
        buffer = tf2_ros.Buffer()
        listener = tf2_ros.TransformListener(buffer)
        self.wait_for_frames(buffer)
        listener.unregister()
        with tempfile.TemporaryDirectory() as folder:
            picture = Path(folder) / "paused.png"
            command = [program("snapshot"), picture]
            run = subprocess.run(
                [*command, "--size", "160x120"], capture_output=True, timeout=DEADLINE
            )
            self.assertEqual(run.returncode, 0, run.stderr)
            self.assertGreater(picture.stat().st_size, 1000)


class TestLaunchedPaused(Paused):
    arguments = ("paused:=true", "initial_pose:=wave")

    def test_a_robot_that_is_launched_paused_is_there(self):
        self.check_that_it_can_be_seen()
        self.check_that_commands_show()


class TestPaused(Paused):
    def setUp(self):
        """Begin while time runs, with the robot as it was at first."""
        self.command(0.0)
        rospy.wait_for_service("/gazebo/unpause_physics", DEADLINE)
        rospy.ServiceProxy("/gazebo/unpause_physics", Empty)()
        rospy.ServiceProxy("/gazebo/reset_world", Empty)()
        before = rospy.Time.now()
        for listener in (self.log, self.states):
            listener.clear()
        self.states.wait(
            lambda m: m.header.stamp > before and position_of(m, ELBOW) == 0.0,
            "time to run",
        )

    def test_a_pause_shows_what_is_there_and_what_changes(self):
        self.command(0.5)
        self.states.wait(
            lambda m: abs(position_of(m, ELBOW) - 0.5) < 1e-9, "the command"
        )
        self.pause()
        stamp = self.states.messages[-1].header.stamp
        gazebos = [
            Connected("/clock", Clock),
            Connected("/gazebo/link_states", LinkStates),
            Connected("/gazebo/model_states", ModelStates),
        ]
        self.check_that_it_can_be_seen()
        self.check_that_commands_show()
        # Whoever has just come makes the last state come again, a nanosecond later.
        stamps = [message.header.stamp.to_nsec() for message in self.states.messages]
        self.assertEqual(stamps, sorted(set(stamps)))
        self.assertLess(stamps[-1] - stamp.to_nsec(), 1.2e9 / RATE)
        for listener in gazebos:
            self.assertEqual(listener.messages, [], listener.topic)
            listener.close()

    def test_the_base_shows_to_the_last_micrometre(self):
        """Less than what the throttle lets pass is shown when nothing follows."""
        buffer = tf2_ros.Buffer()
        listener = tf2_ros.TransformListener(buffer)
        self.addCleanup(listener.unregister)
        mover = rospy.Publisher("/gazebo/set_model_state", ModelState, queue_size=1)
        wait_for(mover.get_num_connections, "the simulator")
        self.pause()
        for x in (0.5, 0.5001, 0.5002):
            state = ModelState(model_name="g1_robot", reference_frame="world")
            state.pose.position.x, state.pose.orientation.w = x, 1.0
            mover.publish(state)

            def is_there(x=x):
                found = buffer.lookup_transform("map", "pelvis", rospy.Time())
                return abs(found.transform.translation.x - x) < 1e-9

            self.wait_for_frames(buffer)
            wait_for(is_there, f"the base at {x}")

    def test_a_pause_that_was_asked_for_is_no_warning(self):
        diagnostics = Listener("/diagnostics", DiagnosticArray)
        self.addCleanup(diagnostics.close)
        self.pause()
        diagnostics.wait(
            lambda m: any(status.message == "paused" for status in m.status), "paused"
        )
        end = time.monotonic() + A_WHILE
        wait_for(lambda: time.monotonic() > end, "a while", 2 * A_WHILE)
        levels = {s.name: s.level for s in diagnostics.messages[-1].status}
        self.assertEqual({n for n, level in levels.items() if level}, set())
        warned = [
            message.msg
            for message in list(self.log.messages)
            if message.level >= Log.WARN and "KDL" not in message.msg
        ]
        self.assertEqual(warned, [])

    def test_a_reset_while_time_stands_still_shows(self):
        self.command(0.5)
        self.states.wait(lambda m: m.header.stamp.to_sec() > 12.0, "twelve seconds")
        buffer = tf2_ros.Buffer()
        listener = tf2_ros.TransformListener(buffer)
        self.addCleanup(listener.unregister)
        self.wait_for_frames(buffer)

        def stamp():
            try:
                found = buffer.lookup_transform("map", "left_elbow_link", rospy.Time())
            except tf2_ros.TransformException:
                return None
            return found.header.stamp.to_sec()

        self.pause()
        # What comes after the reset from before it would make TF refuse what is new.
        last = self.states.messages[-1].header.stamp.to_sec()
        wait_for(lambda: (stamp() or 0.0) > last - 1e-6, "TF of the pause")
        rospy.ServiceProxy("/gazebo/reset_simulation", Empty)()
        self.states.wait(
            lambda m: m.header.stamp.to_sec() < 0.001 and position_of(m, ELBOW) == 0.0,
            "zero",
        )
        wait_for(lambda: (stamp() or 1.0) < 0.001, "TF of the reset")
