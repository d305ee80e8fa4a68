"""Each state comes once, under its own time, however fast a script goes on.

While time stands still the robot can be looked at, by who comes late as well.
"""

import math
import time
import unittest

import numpy as np
import rospy
import tf2_ros
from diagnostic_msgs.msg import DiagnosticArray
from g1_description.msg import ModelTrajectory, RobotState
from g1_description.srv import SetModelTrajectory, Step, StepModel
from gazebo_msgs.msg import LinkStates, ModelState, ModelStates
from gazebo_msgs.srv import (
    GetPhysicsProperties,
    GetWorldProperties,
    SetModelConfiguration,
    SetModelState,
)
from geometry_msgs.msg import Point, Pose, Quaternion, Twist
from rosgraph_msgs.msg import Clock, Log
from scipy.spatial.transform import Rotation
from sensor_msgs.msg import JointState
from std_srvs.srv import Empty
from support.ros_testing import (
    DEADLINE,
    Connected,
    Launch,
    is_at,
    position_of,
    wait_for,
)
from support.seen import Frames, check_that_commands_show
from tf2_msgs.msg import TFMessage

from g1_description.ros.conversions import pose_from_array, pose_to_array

ELBOW = "left_elbow_joint"
MS = 1_000_000
"""[ns]"""
A_WHILE = 2.0
"""So long nothing may be said of a pause, in [s] of wall time."""
ROOM = {"queue_size": 100_000, "buff_size": 1 << 22, "tcp_nodelay": True}


def proxy(name, kind):
    rospy.wait_for_service(f"/gazebo/{name}", DEADLINE)
    return rospy.ServiceProxy(f"/gazebo/{name}", kind, persistent=True)


def stamps_of(messages):
    return [message.header.stamp.to_nsec() for message in messages]


class States(unittest.TestCase):
    """A display, and scripts that set, step and read."""

    rate = 50
    """[Hz, simulated time] Of what the simulator publishes."""
    arguments = ()

    @classmethod
    def setUpClass(cls):
        launch = Launch(
            "display.launch", "rviz:=false", f"rate:={cls.rate}", *cls.arguments
        )
        cls.addClassCleanup(launch.stop)
        cls.states = Connected("/joint_states", JointState, **ROOM)
        cls.addClassCleanup(cls.states.close)
        cls.states.wait()
        cls.pause, cls.reset, cls.go_on = (
            proxy(name, Empty)
            for name in ("pause_physics", "reset_simulation", "unpause_physics")
        )
        cls.step = proxy("step", Step)
        physics = proxy("get_physics_properties", GetPhysicsProperties)
        cls.is_paused_at_first = physics().pause
        cls.commands = rospy.Publisher("/joint_commands", JointState, queue_size=10)
        cls.addClassCleanup(cls.commands.unregister)
        wait_for(cls.commands.get_num_connections, "the bridge")
        cls.configure = proxy("set_model_configuration", SetModelConfiguration)

    def setUp(self):
        """Begin while time runs."""
        self.go_on()
        self.states.clear()
        self.states.wait()

    def stand_still(self):
        """Pause, reset, and wait until the state after that is shown."""
        self.pause()
        self.reset()
        self.states.wait(lambda m: m.header.stamp.to_nsec() < MS, "time to go back")
        self.states.clear()

    def run_script(self, n, steps):
        """Set and step without a pause; the elbow tells each state's number."""
        for number in range(n):
            self.configure("g1_robot", "", [ELBOW], [1e-3 * number])
            self.assertTrue(self.step(steps).success)
        self.states.wait(
            lambda m: m.header.stamp.to_nsec() == n * steps * MS, "the last state"
        )

    def states_of_steps(self):
        """Give the joint states but for those that show what was set between steps.

        They come a nanosecond later, where a step is late on a busy machine.
        """
        return [m for m in self.states.messages if m.header.stamp.to_nsec() % MS == 0]

    def check_that_states_come_at_the_rate(self, gap):
        """Stamps rise by the rate's step; a busy machine may leave some states out.

        Args:
            gap: The step in [ns].
        """
        clock = Connected("/clock", Clock, **ROOM)
        self.addCleanup(clock.close)
        # What was shown while time stood still may have come late.
        begin = self.states.wait().header.stamp + rospy.Duration(0.1)
        end = begin + rospy.Duration(1.0)
        self.states.wait(lambda m: m.header.stamp > end, "1 s")
        clock.wait(lambda m: m.clock > end, "1 s")
        times = [m.clock.to_nsec() for m in list(clock.messages)]
        for stamps in (stamps_of(list(self.states.messages)), times):
            stamps = np.array([stamp for stamp in stamps if stamp > begin.to_nsec()])
            self.assertEqual(np.diff(stamps).min(), gap)
            self.assertEqual(set((stamps % gap).tolist()), {0})

    def check_that_link_states_come_at_the_rate(self, gap):
        """Each is there when time has passed by the rate's step, in [ns]."""
        links = Connected("/gazebo/link_states", LinkStates, **ROOM)
        self.addCleanup(links.close)
        # The publisher may know of it a little later than it does itself.
        links.wait()
        self.stand_still()
        place = rospy.ServiceProxy("/gazebo/set_model_state", SetModelState)

        def count(x):
            """Run half a second with the robot at this place; count what shows it."""
            state = ModelState(model_name="g1_robot")
            state.pose.position.x, state.pose.orientation.w = x, 1.0
            self.assertTrue(place(state).success)
            self.assertTrue(self.step(500).success)
            return lambda: sum(m.pose[1].position.x == x for m in list(links.messages))

        first, second = count(1.0), count(2.0)
        wanted = 500 * MS // gap
        wait_for(lambda: second() >= wanted, f"{wanted} link states")
        self.assertEqual((first(), second()), (wanted, wanted))


class TestStatesOfEachStep(States):
    rate = 1000
    arguments = "fixed_base:=true", "paused:=true"

    def test_0_a_robot_that_is_launched_paused_is_there(self):
        self.assertTrue(self.is_paused_at_first)
        self.pause()
        check_that_commands_show(self.states, self.commands)

    def test_an_argument_of_the_launch_file_is_a_parameter(self):
        """This one has no effect in kinematic physics."""
        self.assertIs(rospy.get_param("/gazebo/fixed_base"), True)

    def test_every_state_of_every_step_comes_once_under_its_own_stamp(self):
        self.stand_still()
        self.run_script(100, 10)
        messages = self.states_of_steps()
        self.assertEqual(stamps_of(messages), [ms * MS for ms in range(1, 1001)])
        told = np.round([1e3 * position_of(message, ELBOW) for message in messages])
        np.testing.assert_array_equal(told, np.repeat(np.arange(100), 10))

    def test_stamps_rise_and_states_come_at_the_rate(self):
        self.check_that_states_come_at_the_rate(MS)

    def test_link_states_come_at_the_rate(self):
        self.check_that_link_states_come_at_the_rate(MS)


class TestStatesAtTheRate(States):
    @classmethod
    def setUpClass(cls):
        super().setUpClass()
        cls.log = Connected("/rosout", Log)
        cls.addClassCleanup(cls.log.close)
        cls.reset_world = proxy("reset_world", Empty)

    def setUp(self):
        """Begin while time runs, with the robot as it was at first."""
        self.command(0.0)
        self.go_on()
        self.reset_world()
        before = self.states.wait().header.stamp
        for listener in (self.log, self.states):
            listener.clear()
        self.states.wait(
            lambda m: m.header.stamp > before and position_of(m, ELBOW) == 0.0,
            "time to run",
        )

    def command(self, position):
        self.commands.publish(JointState(name=[ELBOW], position=[position]))

    def pause_and_wait(self):
        """Pause, and wait for the last time and the last states."""
        self.pause()
        end = proxy("get_world_properties", GetWorldProperties)().sim_time
        wait_for(lambda: abs(rospy.get_time() - end) < 1e-9, "the last /clock")
        self.states.wait(
            lambda m: m.header.stamp.to_sec() > end - 1.02 / self.rate,
            "the last joint states",
        )

    def frames(self):
        """Listen to TF from now on."""
        frames = Frames()
        self.addCleanup(frames.close)
        return frames

    def test_a_pause_shows_what_is_there_and_what_changes(self):
        self.command(0.5)
        self.states.wait(lambda m: is_at(m, ELBOW, 0.5), "the command")
        self.pause_and_wait()
        stamp = self.states.messages[-1].header.stamp
        gazebos = [
            Connected("/clock", Clock),
            Connected("/gazebo/link_states", LinkStates),
            Connected("/gazebo/model_states", ModelStates),
        ]
        check_that_commands_show(self.states, self.commands)
        # Whoever has just come makes the last state come again, a nanosecond later.
        stamps = stamps_of(list(self.states.messages))
        self.assertEqual(stamps, sorted(set(stamps)))
        self.assertLess(stamps[-1] - stamp.to_nsec(), 1.2e9 / self.rate)
        for listener in gazebos:
            self.assertEqual(listener.messages, [], listener.topic)
            listener.close()

    def test_the_base_shows_to_the_last_micrometre(self):
        """Less than what the throttle lets pass is shown when nothing follows."""
        frames = self.frames()
        place = proxy("set_model_state", SetModelState)
        self.pause_and_wait()
        for x in (0.5, 0.5001, 0.5002):
            state = ModelState(model_name="g1_robot", reference_frame="world")
            state.pose.position.x, state.pose.orientation.w = x, 1.0
            self.assertTrue(place(state).success)
            wait_for(
                lambda x=x: (
                    abs(frames.look("pelvis").transform.translation.x - x) < 1e-9
                ),
                f"the base at {x}",
            )

    def test_a_pause_that_was_asked_for_is_no_warning(self):
        diagnostics = Connected("/diagnostics", DiagnosticArray)
        self.addCleanup(diagnostics.close)
        self.pause_and_wait()
        diagnostics.wait(
            lambda m: any(status.message == "paused" for status in m.status), "paused"
        )
        end = time.monotonic() + A_WHILE
        wait_for(lambda: time.monotonic() > end, "a while")
        levels = {s.name: s.level for s in diagnostics.messages[-1].status}
        self.assertEqual({n for n, level in levels.items() if level}, set())
        warned = [
            message.msg
            for message in list(self.log.messages)
            if message.level >= Log.WARN and "KDL" not in message.msg
        ]
        self.assertEqual(warned, [])

    def test_a_reset_while_time_stands_still_shows(self):
        """Also after more time than TF remembers."""
        self.command(0.5)
        self.states.wait(lambda m: is_at(m, ELBOW, 0.5), "the command")
        frames = self.frames()
        self.pause_and_wait()
        self.assertTrue(self.step(12_000).success)
        end = proxy("get_world_properties", GetWorldProperties)().sim_time
        self.states.wait(lambda m: m.header.stamp.to_sec() > end - 1e-6, "the steps")

        def stamp():
            try:
                return frames.look("left_elbow_link").header.stamp.to_sec()
            except tf2_ros.TransformException:  # the time has just gone back
                return math.nan

        # What comes after the reset from before it would make TF refuse what is new.
        wait_for(lambda: stamp() > end - 1e-6, "TF of the pause")
        self.reset()
        self.states.wait(
            lambda m: m.header.stamp.to_sec() < 0.001 and position_of(m, ELBOW) == 0.0,
            "zero",
        )
        wait_for(lambda: stamp() < 0.001, "TF of the reset")

    def test_at_a_lower_rate_the_last_state_of_every_step_comes(self):
        self.stand_still()
        self.run_script(100, 3)
        messages = self.states_of_steps()
        stamps = stamps_of(messages)
        self.assertEqual(stamps, sorted(set(stamps)))
        at = {s: position_of(m, ELBOW) for s, m in zip(stamps, messages)}
        ends = {3 * (number + 1) * MS: 1e-3 * number for number in range(100)}
        self.assertLessEqual(ends.keys(), at.keys())
        for stamp, position in ends.items():
            self.assertAlmostEqual(at[stamp], position, delta=1e-9)
        self.assertLess(len(stamps), 200)

    def test_stamps_rise_and_states_come_at_the_rate(self):
        self.check_that_states_come_at_the_rate(20 * MS)

    def test_link_states_come_at_the_rate(self):
        self.check_that_link_states_come_at_the_rate(20 * MS)

    def test_the_joints_that_go_to_tf_are_those_of_the_bases(self):
        """TF has to interpolate neither of them."""
        joints = Connected("/tf_joint_states", JointState, **ROOM)
        self.addCleanup(joints.close)
        frames = Connected("/tf", TFMessage, **ROOM)
        self.addCleanup(frames.close)
        end = self.states.wait().header.stamp + rospy.Duration(2.0)
        self.states.wait(lambda m: m.header.stamp > end, "2 s")
        bases = {
            edge.header.stamp
            for message in list(frames.messages)
            for edge in message.transforms
            if edge.child_frame_id == "base_link" and edge.header.stamp < end
        }
        shown = {message.header.stamp for message in list(joints.messages)}
        self.assertGreater(len(bases), 20)
        self.assertEqual(
            [stamp for stamp in sorted(bases)[1:] if stamp not in shown], []
        )
        gaps = np.diff([stamp.to_sec() for stamp in sorted(shown)])
        # A busy machine may leave some out.
        self.assertLess(np.median(gaps), 0.0601)

    def move_about(self, states):
        """Set joints and base 50 times; give the states between first and last stamp.

        Args:
            states: Those of robot_state.
        """
        place = rospy.ServiceProxy("/gazebo/set_model_state", SetModelState)
        begin = end = states.wait().header.stamp
        for number in range(50):
            self.configure("g1_robot", "", [ELBOW], [0.002 * number])
            q = Rotation.from_euler("zyx", [0.02 * number, 0.1, -0.1]).as_quat()
            pose = pose_from_array(np.array([0.01 * number, -1.0, 1.0, *q]))
            self.assertTrue(place(ModelState("g1_robot", pose, Twist(), "")).success)
            end = states.wait(lambda m, end=end: m.header.stamp > end).header.stamp
        for topic in (states, self.states):
            topic.wait(lambda m: m.header.stamp > end, "a later state")
        return [
            [m for m in list(topic.messages) if begin < m.header.stamp <= end]
            for topic in (states, self.states)
        ]

    def test_robot_state_has_the_joints_and_the_base_of_one_time(self):
        states = Connected("/robot_state", RobotState, **ROOM)
        self.addCleanup(states.close)
        frames = Connected("/tf", TFMessage, **ROOM)
        self.addCleanup(frames.close)
        whole, joints = self.move_about(states)
        self.assertEqual(stamps_of(whole), stamps_of(joints))
        for state, other in zip(whole, joints):
            self.assertEqual((state.name, state.has_base), (other.name, True))
            for told, expected in (
                (state.position, other.position),
                (state.velocity, other.velocity),
            ):
                np.testing.assert_allclose(told, expected, atol=1e-9)
        pose_at = {m.header.stamp: pose_to_array(m.base_pose) for m in whole}
        bases = [
            edge
            for message in list(frames.messages)
            for edge in message.transforms
            if edge.child_frame_id == "base_link" and edge.header.stamp in pose_at
        ]
        self.assertGreater(len(bases), 10)
        for edge in bases:
            t, q = edge.transform.translation, edge.transform.rotation
            expected = [t.x, t.y, t.z, q.x, q.y, q.z, q.w]
            told = pose_at[edge.header.stamp]
            np.testing.assert_allclose(told, expected, atol=1e-9)

    def test_who_comes_late_gets_the_robot_state_while_time_stands_still(self):
        self.stand_still()
        late = Connected("/robot_state", RobotState)
        self.addCleanup(late.close)
        self.assertEqual(late.wait().header.frame_id, "map")

    def test_bad_requests_get_a_sentence_and_change_nothing(self):
        step_model = proxy("step_model", StepModel)
        self.stand_still()
        before = step_model("g1_robot", [], [], False, Pose(), 0)
        self.assertTrue(before.success)
        pose = Pose(Point(x=float("nan")), Quaternion(w=1.0))
        for words, request in (
            ("model 'ghost'", ("ghost", [], [], False, Pose(), 1)),
            ("no movable joint wing", ("g1_robot", ["wing"], [0.0], False, Pose(), 1)),
            ("got 1 and 0", ("g1_robot", [ELBOW], [], False, Pose(), 1)),
            ("nan", ("g1_robot", [ELBOW], [float("nan")], False, Pose(), 1)),
            ("nan", ("g1_robot", [ELBOW], [1.0], True, pose, 1)),
        ):
            with self.subTest(words):
                answer = step_model(*request)
                self.assertFalse(answer.success)
                self.assertIn(words, answer.status_message)
        after = step_model("g1_robot", [], [], False, Pose(), 0)
        self.assertEqual(after, before)
        clamped = step_model("g1_robot", ["left_knee_joint"], [9.0], False, Pose(), 1)
        self.assertTrue(clamped.success)
        self.assertIn("clamped to the limits: left_knee", clamped.status_message)
        self.assertEqual(clamped.clamped, ["left_knee_joint"])

    def test_a_motion_is_answered_with_what_is_clamped_and_ignored(self):
        play = proxy("set_model_trajectory", SetModelTrajectory)
        motion = ModelTrajectory(model_name="g1_robot", times=[0.0])
        for names, positions, clamped, ignored in (
            ([ELBOW], [0.5], [], []),
            ([ELBOW, "wing"], [9.0, 0.0], [ELBOW], ["wing"]),
        ):
            motion.joint_names, motion.positions = names, positions
            answer = play(motion)
            self.assertTrue(answer.success)
            self.assertEqual((answer.clamped, answer.ignored), (clamped, ignored))
            self.assertEqual(
                "clamped to the limits" in answer.status_message, bool(clamped)
            )
        motion.joint_names, motion.positions = ["wing"], [0.0]
        refused = play(motion)
        reason = "the motion has no joint of g1_robot"
        self.assertEqual((refused.success, refused.status_message), (False, reason))
