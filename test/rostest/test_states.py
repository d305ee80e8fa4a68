"""Each state comes once, under its own time, however fast a script goes on."""

import unittest

import numpy as np
import rospy
from g1_description.msg import ModelTrajectory, RobotState
from g1_description.srv import SetModelTrajectory, Step, StepModel
from gazebo_msgs.msg import LinkStates, ModelState, WorldState
from gazebo_msgs.srv import SetModelConfiguration, SetModelState
from geometry_msgs.msg import Point, Pose, Quaternion, Twist
from rosgraph_msgs.msg import Clock
from scipy.spatial.transform import Rotation
from sensor_msgs.msg import JointState
from std_srvs.srv import Empty
from support.burners import Burners
from support.ros_testing import DEADLINE, Connected, Launch, position_of, wait_for
from tf2_msgs.msg import TFMessage

from g1_description.ros.conversions import pose_from_array, pose_to_array

ELBOW = "left_elbow_joint"
MS = 1_000_000
"""[ns]"""
ROOM = {"queue_size": 100_000, "buff_size": 1 << 22, "tcp_nodelay": True}


def proxy(name, kind):
    rospy.wait_for_service(f"/gazebo/{name}", DEADLINE)
    return rospy.ServiceProxy(f"/gazebo/{name}", kind, persistent=True)


def stamps_of(messages):
    return [message.header.stamp.to_nsec() for message in messages]


class States(unittest.TestCase):
    """A display, and scripts that set, step and read."""

    arguments = ()

    @classmethod
    def setUpClass(cls):
        launch = Launch("display.launch", "rviz:=false", *cls.arguments)
        cls.addClassCleanup(launch.stop)
        cls.states = Connected("/joint_states", JointState, **ROOM)
        cls.addClassCleanup(cls.states.close)
        cls.states.wait()
        cls.pause, cls.reset, cls.go_on = (
            proxy(name, Empty)
            for name in ("pause_physics", "reset_simulation", "unpause_physics")
        )
        cls.step = proxy("step", Step)
        cls.configure = proxy("set_model_configuration", SetModelConfiguration)

    def setUp(self):
        """Begin while time runs."""
        self.go_on()
        self.states.clear()
        self.states.wait()

    def burn(self):
        self.addCleanup(Burners().close)

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
        end = begin + rospy.Duration(2.0)
        self.states.wait(lambda m: m.header.stamp > end, "2 s")
        clock.wait(lambda m: m.clock > end, "2 s")
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
    arguments = ("rate:=1000",)

    def test_every_state_of_every_step_comes_once_under_its_own_stamp(self):
        self.burn()
        self.stand_still()
        self.run_script(300, 10)
        messages = self.states_of_steps()
        self.assertEqual(stamps_of(messages), [ms * MS for ms in range(1, 3001)])
        told = np.round([1e3 * position_of(message, ELBOW) for message in messages])
        np.testing.assert_array_equal(told, np.repeat(np.arange(300), 10))

    def test_stamps_rise_and_states_come_at_the_rate(self):
        self.check_that_states_come_at_the_rate(MS)

    def test_link_states_come_at_the_rate(self):
        self.check_that_link_states_come_at_the_rate(MS)


class TestStatesAtTheRate(States):
    def test_at_a_lower_rate_the_last_state_of_every_step_comes(self):
        self.burn()
        self.stand_still()
        self.run_script(300, 3)
        messages = self.states_of_steps()
        stamps = stamps_of(messages)
        self.assertEqual(stamps, sorted(set(stamps)))
        at = {s: position_of(m, ELBOW) for s, m in zip(stamps, messages)}
        ends = {3 * (number + 1) * MS: 1e-3 * number for number in range(300)}
        self.assertLessEqual(ends.keys(), at.keys())
        for stamp, position in ends.items():
            self.assertAlmostEqual(at[stamp], position, delta=1e-9)
        self.assertLess(len(stamps), 600)

    def test_stamps_rise_and_states_come_at_the_rate(self):
        self.check_that_states_come_at_the_rate(5 * MS)

    def test_link_states_come_at_the_rate(self):
        self.check_that_link_states_come_at_the_rate(5 * MS)

    def test_the_joints_that_go_to_tf_are_those_of_the_bases(self):
        """TF has to interpolate neither of them."""
        joints = Connected("/tf_joint_states", JointState, **ROOM)
        self.addCleanup(joints.close)
        frames = Connected("/tf", TFMessage, **ROOM)
        self.addCleanup(frames.close)
        end = self.states.wait().header.stamp + rospy.Duration(3.0)
        self.states.wait(lambda m: m.header.stamp > end, "3 s")
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
        """Set joints and base 200 times; give the states between first and last stamp.

        Args:
            states: Those of robot_state.
        """
        place = rospy.ServiceProxy("/gazebo/set_model_state", SetModelState)
        begin = end = states.wait().header.stamp
        for number in range(200):
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


class TestStatesInOneCall(States):
    arguments = ("physics:=hold", "fixed_base:=true")

    def test_a_model_is_set_stepped_and_told_in_one_call(self):
        step_model = proxy("step_model", StepModel)
        world = Connected("/gazebo/world_state", WorldState)
        self.addCleanup(world.close)
        q = Rotation.from_euler("zyx", [0.5, -0.3, 0.2]).as_quat()
        pose = Pose(orientation=Quaternion(*q))
        pose.position.x, pose.position.z = 1.0, 2.0
        refused = step_model("g1_robot", [], [], False, Pose(), 1)
        self.assertFalse(refused.success)
        self.assertIn("time is running", refused.status_message)
        self.stand_still()
        world.clear()
        answer = step_model("g1_robot", [ELBOW], [0.7], True, pose, 5)
        self.assertTrue(answer.success, answer)
        self.assertEqual(answer.joint_states.header.stamp.to_nsec(), 5 * MS)
        self.assertEqual(len(answer.joint_states.name), 29)
        self.assertAlmostEqual(position_of(answer.joint_states, ELBOW), 0.7, delta=0.01)
        state = world.wait(lambda m: m.header.stamp.to_nsec() == 5 * MS, "the state")
        row = state.name.index("g1_robot::pelvis")
        self.assertEqual(state.pose[row], answer.base_pose)
        self.assertEqual(state.twist[row], answer.base_twist)
        shown = self.states.wait(lambda m: m.header.stamp.to_nsec() == 5 * MS)
        np.testing.assert_allclose(
            shown.position, answer.joint_states.position, atol=1e-9
        )
        np.testing.assert_allclose(
            shown.velocity, answer.joint_states.velocity, atol=1e-9
        )
