"""With motors the robot stands and does what it is told."""

import unittest
from contextlib import closing
from functools import partial

import numpy as np
import rospy
import tf2_ros
from g1_description.msg import (
    MotorCommands,
    MotorStates,
    RobotTrajectory,
    TrackingReport,
)
from g1_description.srv import (
    GetAnchor,
    GetHistory,
    PlayMotion,
    SetAnchor,
    SetGantry,
    StepModel,
)
from gazebo_msgs.msg import WorldState
from gazebo_msgs.srv import ApplyBodyWrench, GetJointProperties, GetModelState
from geometry_msgs.msg import Point, Pose, Quaternion, Vector3, Wrench
from rosgraph_msgs.msg import Log
from scipy.spatial.transform import Rotation
from sensor_msgs.msg import JointState
from std_srvs.srv import Empty, Trigger
from support.programs import Program
from support.ros_testing import (
    DEADLINE,
    Connected,
    Listener,
    Repeated,
    position_of,
    service,
    wait_for,
)
from trajectory_msgs.msg import JointTrajectory, JointTrajectoryPoint

from g1_description.cli.pose import PosedRobot
from g1_description.robot.poses import pose_positions, read_poses
from g1_description.ros.history import HistoryClient
from g1_description.web.live_simulator import LiveSimulator

ELBOW = "left_elbow_joint"
MS = 1_000_000
"""[ns]"""


def has_words(words, line):
    """Tell whether a line of the log has some words."""
    return words in line.msg


class TestPhysics(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.states = Listener("/joint_states", JointState)
        rospy.wait_for_service("/gazebo/set_parameters", DEADLINE)
        cls.model_state = rospy.ServiceProxy("/gazebo/get_model_state", GetModelState)

    def height(self):
        return self.position()[2]

    def position(self):
        place = self.model_state("g1_robot", "").pose.position
        return np.array([place.x, place.y, place.z])

    def test_0_an_anchor_is_ignored_at_the_start_and_refused_later(self):
        """The launch file of ``hold`` has one."""
        get = rospy.ServiceProxy("/gazebo/get_anchor", GetAnchor)
        self.assertEqual(get("g1_robot").link_name, "")
        rospy.wait_for_service("/set_anchor", DEADLINE)
        answer = rospy.ServiceProxy("/set_anchor", SetAnchor)(link_name="pelvis")
        self.assertFalse(answer.success)
        self.assertIn("needs kinematic physics; in ", answer.status_message)

    def test_1_velocities_are_the_slopes_of_positions(self):
        """Trapezoid rule over fifty messages; a robot that stands does not move.

        It is let go a hair above the floor: its first step has no slope.
        """
        rospy.ServiceProxy("/gazebo/unpause_physics", Empty)()
        self.states.wait(
            lambda m: np.abs(m.velocity).max() <= 0.01, "the end of the motion"
        )
        self.states.clear()
        wait_for(lambda: len(self.states.messages) > 50, "fifty messages")
        messages = self.states.messages[:50]
        stamps = np.array([m.header.stamp.to_sec() for m in messages])
        self.assertAlmostEqual(np.diff(stamps).min(), 0.02, 9)
        position = np.array([m.position for m in messages])
        velocity = np.array([m.velocity for m in messages])
        mean = 0.5 * (velocity[1:] + velocity[:-1])
        moved = np.sum(mean * np.diff(stamps)[:, np.newaxis], axis=0)
        change = position[-1] - position[0]
        np.testing.assert_allclose(
            moved, change, atol=0.1 * np.abs(change).max() + 1e-3
        )

    def test_1_the_history_has_the_efforts_of_the_motors(self):
        rospy.ServiceProxy("/gazebo/unpause_physics", Empty)()
        motors = Listener("/gazebo/motor_states", MotorStates)
        self.addCleanup(motors.close)
        wait_for(lambda: len(motors.messages) > 9, "states of the motors")
        history = service("/get_history", GetHistory)

        def known():
            """Return a state of the motors, and its answer; the bridge joins late."""
            sent = motors.messages[-9]
            answer = history(begin=sent.header.stamp, end=sent.header.stamp)
            is_known = answer.efforts and np.isfinite(answer.efforts).all()
            return (sent, answer) if is_known else None

        sent, answer = wait_for(known, "efforts")
        self.assertEqual(answer.states.start, sent.header.stamp)
        self.assertEqual(answer.states.joint_names, sent.joint_names)
        np.testing.assert_array_equal(answer.efforts, np.float32(sent.tau))

    def test_2_it_stands(self):
        start = rospy.Time.now()
        wait_for(lambda: (rospy.Time.now() - start).to_sec() > 1.0, "a second")
        self.assertAlmostEqual(self.height(), 0.79, delta=0.02)

    def test_3_the_frame_of_the_base_follows(self):
        buffer = tf2_ros.Buffer()
        tf2_ros.TransformListener(buffer)

        def agrees():
            try:
                frame = buffer.lookup_transform("map", "pelvis", rospy.Time())
            except tf2_ros.TransformException:
                return False
            return abs(frame.transform.translation.z - self.height()) < 0.01

        wait_for(agrees, "map -> pelvis at the model's height")

    def test_4_a_command_moves_a_joint_and_motors_hold_it(self):
        commands = rospy.Publisher("/joint_commands", JointState, queue_size=1)
        wait_for(commands.get_num_connections, "the bridge to listen")
        elbow = self.states.wait().name.index("left_elbow_joint")
        command = JointState(name=["left_elbow_joint"], position=[0.5])
        commands.publish(command)
        arrived = self.states.wait(lambda m: abs(m.position[elbow] - 0.5) < 0.02, "0.5")
        later = self.states.wait(
            lambda m: (m.header.stamp - arrived.header.stamp).to_sec() > 0.5, "0.5 s"
        )
        self.assertAlmostEqual(later.position[elbow], 0.5, delta=0.02)

    def test_5_it_squats_and_stands_again_on_its_motors(self):
        """It is not thrown, and the simulator tells how well the motors followed."""
        tracking = Listener("/gazebo/tracking", TrackingReport)
        begin = self.position()
        tracking.clear()
        told = []
        robot = PosedRobot("", told.append)
        poses = read_poses(robot.description)
        for number, (name, height) in enumerate((("squat", 0.38), ("zero", 0.79)), 1):
            goal = pose_positions(poses[name], robot.description)
            robot.move(goal, 2.0)
            self.assertAlmostEqual(self.position()[2], height, delta=0.05)
            wait_for(lambda n=number: len(tracking.messages) >= n, "a report")
        self.assertLess(np.linalg.norm(self.position() - begin), 0.03)
        self.assertEqual(told, [])
        names = self.states.wait().name
        for report in tracking.messages:
            self.assertEqual(
                (report.model_name, report.joint_names), ("g1_robot", names)
            )
            self.assertAlmostEqual(report.duration, 2.0, delta=0.01)
            self.assertLess(max(report.rms_errors), 0.02)
            self.assertLess(max(report.limit_shares), 0.1)
            self.assertFalse(report.has_fallen)

    def test_5_the_robot_is_put_back_to_a_state_of_its_past(self):
        history = HistoryClient("/get_history")
        self.addCleanup(history.close)
        past = history.whole().stretch.states()
        low = min(past, key=lambda state: state.base_pose[2])
        self.assertLess(low.base_pose[2], 0.45)  # it has squatted
        rospy.ServiceProxy("/gazebo/pause_physics", Empty)()
        joint = rospy.ServiceProxy("/gazebo/get_joint_properties", GetJointProperties)
        LiveSimulator("gazebo").place("g1_robot", low)
        np.testing.assert_allclose(self.position(), low.base_pose[:3], atol=1e-9)
        for name, position in low.positions_by_name.items():
            self.assertAlmostEqual(joint(name).position[0], position, 9)
        self.states.clear()
        rospy.ServiceProxy("/gazebo/unpause_physics", Empty)()
        begin = self.states.wait().header.stamp
        self.states.wait(lambda m: (m.header.stamp - begin).to_sec() > 1.0, "a second")
        moved = np.linalg.norm(self.position() - low.base_pose[:3])
        self.assertLess(moved, 0.03)  # it stays there, at rest

    def test_6_that_motors_jump_to_a_motion_is_told(self):
        play = rospy.ServiceProxy("/play_motion", PlayMotion)
        motion = RobotTrajectory()
        trajectory = motion.joint_trajectory
        trajectory.joint_names = ["left_wrist_roll_joint"]
        jump = r"left_wrist_roll_joint is 0\.(4[5-9]|50) rad away"
        for begin, told in ((0.5, ""), (0.0, jump)):
            trajectory.points = [
                JointTrajectoryPoint(
                    positions=[position], time_from_start=rospy.Duration(begin + time)
                )
                for time, position in ((0.0, 0.5), (1.0, 0.0))
            ]
            play(RobotTrajectory(joint_trajectory=at_zero(trajectory)))
            self.wait_for_wrist(0.0)
            answer = play(motion)
            self.assertTrue(answer.success)
            self.assertEqual("away from it" in answer.status_message, bool(told))
            if told:
                self.assertRegex(answer.status_message, told)

    def wait_for_wrist(self, wanted):
        self.states.clear()
        self.states.wait(
            lambda m: (
                abs(m.position[m.name.index("left_wrist_roll_joint")] - wanted) < 0.02
            )
        )

    def test_7_a_model_is_set_stepped_and_told_in_one_call(self):
        step_model = rospy.ServiceProxy("/gazebo/step_model", StepModel)
        world = Connected("/gazebo/world_state", WorldState)
        self.addCleanup(world.close)
        q = Rotation.from_euler("zyx", [0.5, -0.3, 0.2]).as_quat()
        pose = Pose(orientation=Quaternion(*q))
        pose.position.x, pose.position.z = 1.0, 2.0
        refused = step_model("g1_robot", [], [], False, Pose(), 1)
        self.assertFalse(refused.success)
        self.assertIn("time is running", refused.status_message)
        for name in ("pause_physics", "reset_simulation"):
            rospy.ServiceProxy(f"/gazebo/{name}", Empty)()
        self.states.wait(lambda m: m.header.stamp.to_nsec() < MS, "time to go back")
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

    def test_8_a_controller_lifts_an_arm_of_the_robot_on_the_gantry(self):
        rospy.ServiceProxy("/gazebo/unpause_physics", Empty)()
        gantry = rospy.ServiceProxy("/gazebo/set_gantry", SetGantry)
        refused = gantry("g1_robot", "", True, 4.0)
        self.assertEqual(refused.status_message, "length must be from 0 to 3 m (got 4)")
        self.assertEqual(gantry("g1_robot", "", True, 1.7).length, 1.7)
        wait_for(lambda: self.height() > 0.9, "the pelvis in the air")
        commands = rospy.Publisher(
            "/gazebo/motor_commands", MotorCommands, queue_size=10
        )
        self.addCleanup(commands.unregister)
        wait_for(commands.get_num_connections, "the simulator to listen")
        elbow = {"model_name": "g1_robot", "joint_names": [ELBOW]}
        log = Connected("/rosout", Log)
        self.addCleanup(log.close)
        for bad, words in (
            (
                MotorCommands(**elbow, kp=[-1.0]),
                f"motor_commands: refused, kp of {ELBOW} must not be negative (got -1)",
            ),
            (
                MotorCommands(model_name="g1_robot", joint_names=[ELBOW, ELBOW]),
                f"motor_commands: refused, joint_names has {ELBOW} more than once",
            ),
            (
                MotorCommands(model_name="g1_robot", joint_names=["elbow"]),
                "g1_robot: motor_commands: ignored, no movable joint of g1_robot: "
                "elbow",
            ),
        ):
            # Again and again: the log may hear other nodes before the simulator.
            with closing(Repeated(partial(commands.publish, bad), 0.2)):
                log.wait(partial(has_words, words), words)
        commands.publish(MotorCommands(**elbow, q=[1.0], kp=[60.0], kd=[4.0]))
        self.states.clear()
        self.states.wait(lambda m: abs(position_of(m, ELBOW) - 1.0) < 0.1, "the elbow")
        motors = Connected("/gazebo/motor_states", MotorStates)
        self.addCleanup(motors.close)

        def holds(m):
            """Tell whether the elbow's effort is that of the command."""
            row = m.joint_names.index(ELBOW)
            effort = 60.0 * (1.0 - m.q[row]) - 4.0 * m.dq[row]
            return m.model_name == "g1_robot" and abs(m.tau[row] - effort) < 0.3

        state = motors.wait(holds, "the effort of a spring")
        self.assertEqual(len(state.tau), 29)
        self.assertNotEqual(state.header.stamp.to_nsec(), 0)
        commands.publish(MotorCommands(**elbow, tau=[-8.0], kd=[4.0]))
        self.states.wait(lambda m: position_of(m, ELBOW) < 0.0, "the effort")
        self.assertEqual(gantry("g1_robot", "", False, 0.0).length, 0.0)
        wait_for(lambda: self.height() < 0.85, "the robot on its feet, or the floor")
        rospy.ServiceProxy("/gazebo/reset_simulation", Empty)()

    def test_9_a_push_is_the_first_cause_of_a_fall(self):
        wait_for(lambda: self.height() > 0.7, "the robot on its feet")
        push = service("/gazebo/apply_body_wrench", ApplyBodyWrench)
        force = Wrench(force=Vector3(x=-300.0))
        given = "g1_robot::torso_link", "world", Point(), force
        push(*given, rospy.Time(), rospy.Duration(0.2))
        wait_for(lambda: self.height() < 0.4, "a fall")
        self.addCleanup(rospy.ServiceProxy("/gazebo/reset_simulation", Empty))
        words = "The robot falls at .* First cause, .*: pelvis is pushed .* backwards"
        why = Program("why")
        printed, errors = why.communicate()
        self.assertRegex(printed, words, errors)
        self.assertEqual(why.returncode, 1)
        answer = service("/checker/why", Trigger)()
        self.assertTrue(answer.success, answer.message)
        self.assertRegex(answer.message, words)


def at_zero(trajectory):
    """Give a command that puts the same joints to zero."""
    zeros = [0.0] * len(trajectory.joint_names)
    points = [JointTrajectoryPoint(positions=zeros)]
    return JointTrajectory(joint_names=trajectory.joint_names, points=points)
