"""/diagnostics tells what is wrong with level and words, and that it is over."""

import math
import threading
import unittest
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import rospy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from g1_description.msg import ModelTrajectory, RobotTrajectory
from g1_description.srv import SetModelTrajectory, SetModelTrajectoryResponse
from gazebo_msgs.msg import ModelState
from gazebo_msgs.srv import GetPhysicsProperties, GetPhysicsPropertiesResponse
from geometry_msgs.msg import PoseStamped
from sensor_msgs.msg import JointState
from support.bridge.arm import URDF, arm_states, run_clock, shows
from support.bridge.process import Bridge
from support.bridge.watched import Watched
from support.ros_testing import Connected, Repeated, wait_for
from support.wire.raw_service import SUCCESS, Gate, Simulator, refusal
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from g1_description.bridge.commands import JointCommands
from g1_description.bridge.player import MotionPlayer
from g1_description.bridge.status import RobotStatus
from g1_description.motion.motion import Motion
from g1_description.robot.state import RobotState
from g1_description.robot.urdf import parse_urdf
from g1_description.ros.log import ThrottledLog

from tcpros import body_of

OK, WARN, ERROR = DiagnosticStatus.OK, DiagnosticStatus.WARN, DiagnosticStatus.ERROR
LINK_STATES, COMMANDS, JOINTS = "link states", "commands", "arm joints"


def command(**positions):
    return JointState(name=[*positions], position=[*positions.values()])


class TestBridgeHealth(unittest.TestCase):
    """A bridge with a simulator that shows the arm fifty times a second."""

    @classmethod
    def setUpClass(cls):
        rospy.set_param("/robot_description", URDF)
        rospy.set_param("/use_sim_time", True)
        cls.addClassCleanup(rospy.set_param, "/use_sim_time", False)
        cls.addClassCleanup(run_clock(period=0.02).close)
        cls.space = "/health"
        cls.simulator = Simulator(f"{cls.space}/gazebo/set_model_configuration")
        cls.addClassCleanup(lambda: cls.simulator.close())
        cls.watched = Watched(cls.space)
        cls.addClassCleanup(cls.watched.bridge.kill)
        cls.addClassCleanup(cls.watched.close)
        cls.statuses = Connected("/diagnostics", DiagnosticArray)
        cls.addClassCleanup(cls.statuses.close)
        cls.shown = [arm_states()]
        cls.addClassCleanup(Repeated(cls.show, 0.02).close)

    def setUp(self):
        type(self).shown = [arm_states()]
        self.simulator.answers = lambda model: SUCCESS
        self.watched.log.clear()

    @classmethod
    def show(cls):
        for message in cls.shown:
            cls.watched.send(body_of(message))

    @classmethod
    def see(cls, *messages):
        """Let the simulator show this from now on."""
        cls.shown = messages

    def command(self, **positions):
        self.watched.commands.publish(command(**positions))

    def wait_for(self, part, level, *words, bridge=None):
        """Wait for a status of a part of the bridge, as it is from now on."""
        name = f"{(bridge or self.watched.bridge).name[1:]}: {part}"

        def says_so(message):
            return any(
                status.level == level and all(word in status.message for word in words)
                for status in message.status
                if status.name == name
            )

        self.statuses.clear()
        self.statuses.wait(says_so, f"{name}: {level} {words}")

    def values(self, bridge=None):
        """Give the values of the last status of commands."""
        name = f"{(bridge or self.watched.bridge).name[1:]}: {COMMANDS}"
        (*_, last) = [
            status
            for message in list(self.statuses.messages)
            for status in message.status
            if status.name == name
        ]
        return {value.key: value.value for value in last.values}

    def test_1_a_bridge_without_a_simulator_warns_in_each_part(self):
        bridge = Bridge(
            "_gazebo:=/none/gazebo", "_model_name:=arm", name="/none/bridge"
        )
        self.addCleanup(bridge.kill)
        self.wait_for(LINK_STATES, WARN, "no valid message on", bridge=bridge)
        self.wait_for(JOINTS, WARN, "no link states arrive", bridge=bridge)
        paused = rospy.Service(
            "/none/gazebo/get_physics_properties",
            GetPhysicsProperties,
            lambda _: GetPhysicsPropertiesResponse(pause=True),
        )
        self.addCleanup(paused.shutdown)
        self.wait_for(LINK_STATES, OK, "paused", bridge=bridge)
        self.wait_for(JOINTS, WARN, "no link states arrive", bridge=bridge)

    def test_2_refused_commands_are_a_warning_until_one_is_obeyed(self):
        self.simulator.answers = lambda model: refusal("not today")
        self.command(elbow=0.1)
        self.wait_for(COMMANDS, WARN, "arm", "not today")
        self.simulator.answers = lambda model: SUCCESS
        self.command(elbow=0.2)
        self.wait_for(COMMANDS, OK, "commands are applied")

    def test_4_a_service_that_is_not_there_is_an_error_until_it_is(self):
        self.simulator.close()
        self.command(elbow=0.1)
        self.wait_for(COMMANDS, ERROR, "has not answered for")
        type(self).simulator = Simulator(self.simulator.name)
        self.wait_for(COMMANDS, OK, "commands are applied")

    def test_5_link_states_that_stay_away_are_a_warning_until_they_come(self):
        self.see()
        self.wait_for(LINK_STATES, WARN, "no message on", self.watched.topic)
        self.see(arm_states())
        self.wait_for(LINK_STATES, OK, "link states arrive")

    def test_6_missing_links_are_an_error_until_they_are_there(self):
        without_fore = arm_states()
        for field in ("name", "pose", "twist"):
            del getattr(without_fore, field)[3]
        broken = arm_states()
        broken.pose[3].position.x = math.nan
        self.see(without_fore)
        self.wait_for(JOINTS, ERROR, "missing links", "fore")
        self.see(arm_states(model="leg"))
        self.wait_for(JOINTS, ERROR, "no link of arm")
        self.see(broken)
        self.wait_for(JOINTS, ERROR, "missing links", "fore")
        self.see(arm_states())
        self.wait_for(JOINTS, OK, "3 joints are published")

    def test_7_a_link_off_its_axis_is_a_warning_until_it_is_back(self):
        tilted = arm_states()
        for pose in tilted.pose[3:]:  # what hangs on the elbow
            pose.orientation.x = math.sin(0.1)
            pose.orientation.w = math.cos(0.1)
        self.see(tilted)
        self.wait_for(JOINTS, WARN, "off their axes for 2 s: elbow")
        line = self.watched.log.wait(lambda m: "off their axes" in m.msg)
        self.assertIn("elbow by 0.2 rad", line.msg)
        self.see(arm_states())
        self.wait_for(JOINTS, OK, "3 joints are published")

    def test_9_a_service_that_hangs_for_one_of_two_robots_is_an_error(self):
        simulator = Simulator("/pair/gazebo/set_model_configuration")
        self.addCleanup(simulator.close)
        watched = Watched(
            "/pair", "_robots:=[{name: arm, namespace: pair}, {name: two}]"
        )
        self.addCleanup(watched.bridge.kill)
        self.addCleanup(watched.close)
        gate = Gate()
        self.addCleanup(gate.open)
        simulator.answers = lambda m: gate(m) if m == "two" else SUCCESS
        two = rospy.Publisher("/two/joint_commands", JointState, queue_size=10)
        self.addCleanup(two.unregister)
        wait_for(two.get_num_connections, "the bridge to listen for the second robot")
        two.publish(command(elbow=0.1))
        self.wait_for(COMMANDS, ERROR, "has not answered for", bridge=watched.bridge)
        watched.commands.publish(command(elbow=0.2))
        wait_for(lambda: simulator.state, "the first robot's")
        self.assertEqual(simulator.state, {"arm": {"elbow": 0.2}})
        for publisher in (watched.commands, two):
            publisher.publish(command(wing=0.0))
        gate.open()
        wanted = {"ignored arm::wing": 1, "ignored two::wing": 1}
        self.wait_for_values(wanted, watched.bridge)

    def test_a_clamped_positions_and_another_publisher_are_warnings_until_over(self):
        """The test publishes the time too, as rosbag play --clock does."""
        topic = self.watched.states.topic
        other = rospy.Publisher(topic, JointState, queue_size=1)
        self.addCleanup(other.unregister)
        self.wait_for(
            JOINTS, WARN, "joint_states are also published by", rospy.get_name()
        )
        words = f"{rospy.get_name()} also publishes /clock and {topic}"
        line = self.watched.log.wait(lambda m: words in m.msg, words)
        self.assertIn("roslaunch g1_description view.launch", line.msg)
        self.command(elbow=9.0, slide=0.0)
        self.command(elbow=-9.0, slide=-9.0)
        line = self.watched.log.wait(lambda m: "clamped to the limits" in m.msg)
        self.assertIn("joint command to arm is clamped", line.msg)
        self.wait_for(COMMANDS, WARN, "clamped to the limits of arm: elbow, slide")
        values = self.values()
        self.assertEqual(values["clamped elbow"], "2")
        self.assertEqual(values["clamped slide"], "1")
        self.assertFalse([name for name in values if name.startswith("ignored")])
        self.wait_for(COMMANDS, OK, "nothing was clamped or ignored in the last 10 s")
        self.assertEqual(self.values()["clamped elbow"], "2")
        # By now a second line would have come.
        told = [m.msg for m in self.watched.log.messages if "also publishes" in m.msg]
        self.assertEqual(len(told), 1)
        other.unregister()
        self.wait_for(JOINTS, OK, "3 joints are published")

    def test_b_what_is_ignored_is_counted_by_name(self):
        for _ in range(3):
            self.command(wing=0.0, elbow=math.nan)
        self.watched.commands.publish(JointState(name=["slide"], position=[]))
        self.wait_for(
            COMMANDS, WARN, "ignored in a command to arm: no position for slide"
        )
        values = self.values()
        self.assertEqual(values["ignored wing"], "3")
        self.assertEqual(values["ignored elbow"], "3")
        self.assertEqual(values["ignored slide"], "1")

    def publisher(self, topic, kind):
        """Connect to a topic of the bridge."""
        publisher = rospy.Publisher(f"{self.space}/{topic}", kind, queue_size=100)
        self.addCleanup(publisher.unregister)
        wait_for(publisher.get_num_connections, f"the bridge to listen to {topic}")
        return publisher

    def wait_for_values(self, wanted, bridge=None):
        """Wait until the status of commands has values, given by their keys."""

        def are_there():
            found = self.values(bridge)
            return all(found.get(key) == str(value) for key, value in wanted.items())

        wait_for(are_there, str(wanted))

    def test_d_samples_that_no_state_shows_are_counted(self):
        """Here none comes between them; on a busy machine it is late."""
        places = rospy.Subscriber(f"{self.space}/gazebo/set_model_state", ModelState)
        self.addCleanup(places.unregister)
        wait_for(places.get_num_connections, "the bridge's base poses")
        motion = self.publisher("motion", RobotTrajectory)
        base = self.publisher("base_command", PoseStamped)
        self.see()
        self.wait_for(LINK_STATES, WARN, "no message on")
        for n in range(1, 4):
            point = JointTrajectoryPoint(positions=[0.1 * n])
            sample = JointTrajectory(joint_names=["elbow"], points=[point])
            motion.publish(RobotTrajectory(joint_trajectory=sample))
            base.publish(PoseStamped())
            self.wait_for_values({"motion received": n, "base_command received": n})
        superseded = {
            "motions superseded before shown": 2,
            "base commands superseded before shown": 2,
        }
        self.wait_for_values(superseded)
        self.see(arm_states())
        self.simulator.wait_for_request(elbow=0.1 * 3)
        motion.publish(RobotTrajectory(joint_trajectory=sample))
        self.wait_for_values({"motion received": 4, **superseded})
        bad = JointTrajectory(joint_names=["wing"], points=[point])
        motion.publish(RobotTrajectory(joint_trajectory=bad))
        self.wait_for_values({"motion received": 5, "motion refused": 1})

    def test_e_states_come_while_a_motion_has_no_answer(self):
        may_answer, asked = threading.Event(), threading.Event()

        def play(request):
            asked.set()
            may_answer.wait()
            return SetModelTrajectoryResponse(success=True)

        name = f"{self.space}/gazebo/set_model_trajectory"
        service = rospy.Service(name, SetModelTrajectory, play)
        self.addCleanup(service.shutdown)
        self.addCleanup(may_answer.set)
        motion = self.publisher("motion", RobotTrajectory)
        points = [JointTrajectoryPoint(positions=[n]) for n in (0.0, 0.1)]
        points[1].time_from_start = rospy.Duration(1.0)
        elbow = JointTrajectory(joint_names=["elbow"], points=points)
        motion.publish(RobotTrajectory(joint_trajectory=elbow))
        wait_for(asked.is_set, "the bridge to call the simulator")
        for shoulder in (0.1, 0.2, 0.3):
            self.see(arm_states(shoulder))
            positions = {"shoulder": shoulder, "elbow": 0.0, "slide": 0.0}
            self.watched.states.wait(lambda m, to=positions: shows(m, to), "the state")
        self.assertFalse(may_answer.is_set())

    def test_g_a_reset_does_not_wait_for_the_answer_to_a_command(self):
        """States wait for a reset; this simulator plays no motions itself."""
        simulator = Simulator("/reset/gazebo/set_model_configuration")
        self.addCleanup(simulator.close)
        is_reset, came_first = threading.Event(), []

        def answer(model):
            came_first.append(is_reset.wait(0.5))
            return SUCCESS

        simulator.answers = answer
        status, log = RobotStatus("arm", parse_urdf(URDF)), ThrottledLog()
        commands = JointCommands("/reset/gazebo", status.name, status.commands, log)
        player = MotionPlayer("/reset/gazebo", status, commands)
        still = np.zeros(1)
        status.state = RobotState(10**9, ("elbow",), still, still)
        player.play(Motion(np.arange(2.0), ("elbow",), np.ones((2, 1))))
        player.observe(status.state, None)
        wait_for(lambda: simulator.requests, "a request")
        player.reset()
        is_reset.set()
        wait_for(lambda: came_first, "the answer")
        self.assertEqual(came_first, [True])

    def test_f_what_comes_during_a_call_counts_after_its_motion(self):
        """As in the simulator, which has the motion before it answers."""
        asked, is_over = threading.Event(), threading.Event()

        def play(request):
            if not asked.is_set():
                asked.set()
                is_over.wait(0.2)  # what overtakes the answer does so by then
            return SetModelTrajectoryResponse(success=True, start=rospy.Time(5))

        service = f"{self.space}/gazebo/set_model_trajectory"
        server = rospy.Service(service, SetModelTrajectory, play)
        self.addCleanup(server.shutdown)
        places = f"{self.space}/gazebo/set_model_state"
        for topic, kind in ((service, ModelTrajectory), (places, ModelState)):
            self.addCleanup(rospy.Subscriber(topic, kind).unregister)
        gazebo, status = f"{self.space}/gazebo", RobotStatus("arm", parse_urdf(URDF))
        log = ThrottledLog()
        commands = JointCommands(gazebo, status.name, status.commands, log)
        player = MotionPlayer(gazebo, status, commands)
        bases = np.tile([0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0], (2, 1))
        sample = Motion(np.zeros(1), ("elbow",), np.zeros((1, 1)))
        joints = Motion(np.arange(2.0), ("elbow",), np.zeros((2, 1)))
        base = Motion(np.arange(2.0), (), np.zeros((2, 0)), base_poses=bases)
        wait_for(lambda: player.place_base(bases[0]).success, "the base poses")
        for what, motion, act in (
            ("another motion", joints, lambda: player.play(joints)),
            ("a streamed sample", joints, lambda: player.stream(sample)),
            ("a stop", joints, player.stop),
            ("a joint command", joints, lambda: player.command({"elbow": 1.0})),
            ("a base command", base, lambda: player.place_base(bases[0])),
        ):
            with self.subTest(what), ThreadPoolExecutor() as pool:
                player.reset()
                asked.clear()
                is_over.clear()
                first = pool.submit(player.play, motion)
                wait_for(asked.is_set, "the call")
                act()
                is_over.set()
                self.assertTrue(first.result().claim.is_lost(0))
