"""An anchored link on the robot's topics: where scipy and TF see it."""

import signal
import tempfile
import unittest
from pathlib import Path

import numpy as np
import rospy
import tf2_ros
from g1_description.msg import RobotState, RobotTrajectory
from g1_description.srv import GetAnchor, PlayMotion, SetAnchor
from geometry_msgs.msg import PoseStamped, Transform
from sensor_msgs.msg import JointState
from std_srvs.srv import Empty
from support.pose_command import POSES
from support.pose_command import run as run_pose
from support.pose_command import start as start_pose
from support.programs import run
from support.ros_testing import (
    Connected,
    position_of,
    service,
    step_by,
    wait_for,
)
from tf2_msgs.msg import TFMessage
from trajectory_msgs.msg import (
    JointTrajectory,
    JointTrajectoryPoint,
    MultiDOFJointTrajectoryPoint,
)

UPRIGHT = [0.0, 0.0, 0.793, 0.0, 0.0, 0.0, 1.0]
LEFT, RIGHT = "left_ankle_roll_link", "right_ankle_roll_link"
KNEE = "left_knee_joint"
SQUAT = {
    f"{side}_{joint}_joint": position
    for side in ("left", "right")
    for joint, position in (("hip_pitch", -0.5), ("knee", 1.0), ("ankle_pitch", -0.5))
}
"""The soles stay parallel to the pelvis."""


def numbers(pose):
    p, q = pose.position, pose.orientation
    return np.array([p.x, p.y, p.z, q.x, q.y, q.z, q.w])


class TestAnchor(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        step_by(0.005)
        cls.urdf = rospy.get_param("/robot_description")
        every = {"queue_size": None, "tcp_nodelay": True}
        cls.states = Connected("/robot_state", RobotState, **every)
        cls.tf = Connected("/tf", TFMessage, **every)
        cls.joints = Connected("/tf_joint_states", JointState, **every)
        cls.static = Connected("/tf_static", TFMessage, **every)
        for listener in (cls.states, cls.tf, cls.joints, cls.static):
            cls.addClassCleanup(listener.close)
        cls.publishers = {
            name: rospy.Publisher(f"/{name}", kind, queue_size=100)
            for name, kind in (
                ("joint_trajectory", JointTrajectory),
                ("joint_commands", JointState),
                ("base_command", PoseStamped),
            )
        }
        for publisher in cls.publishers.values():
            wait_for(publisher.get_num_connections, f"a listener of {publisher.name}")
        cls.play = service("/play_motion", PlayMotion)
        cls.set_anchor = service("/set_anchor", SetAnchor)
        cls.get_anchor = service("/gazebo/get_anchor", GetAnchor)
        cls.names = cls.states.wait().name
        cls.static.wait(
            lambda m: any(t.child_frame_id == "pelvis" for t in m.transforms)
        )

    def setUp(self):
        """Begin with a robot that stands at zero, without an anchor."""
        service("/gazebo/unpause_physics", Empty)()
        self.anchor("")
        zero = RobotTrajectory()
        joints, base = zero.joint_trajectory, zero.multi_dof_joint_trajectory
        joints.joint_names, base.joint_names = self.names, ["base"]
        joints.points = [JointTrajectoryPoint(positions=[0.0] * len(self.names))]
        upright = Transform()
        upright.translation.z, upright.rotation.w = UPRIGHT[2], 1.0
        base.points = [MultiDOFJointTrajectoryPoint(transforms=[upright])]
        for message in (RobotTrajectory(), zero):
            self.assertTrue(self.play(message).success)
        self.states.clear()
        self.states.wait(
            lambda m: not any(m.position) and (numbers(m.base_pose) == UPRIGHT).all(),
            "zero",
        )
        self.clear()

    def clear(self):
        for listener in (self.states, self.tf, self.joints):
            listener.clear()

    def anchor(self, link):
        answer = self.set_anchor(link_name=link)
        self.assertTrue(answer.success, answer.status_message)

    def anchor_now(self):
        return self.get_anchor("g1_robot").link_name

    def feet(self, names, positions, base):
        """Place both feet by scipy, shape (2, 7)."""
        from oracle import forward_kinematics

        placed = forward_kinematics(self.urdf, base, dict(zip(names, positions)))
        return np.array([placed[LEFT], placed[RIGHT]])

    def feet_of(self, state):
        return self.feet(state.name, state.position, numbers(state.base_pose))

    def squat(self, seconds=1.0):
        """Squat by a trajectory of the legs alone; give all states meanwhile."""
        message = JointTrajectory(joint_names=[*SQUAT])
        message.points = [
            JointTrajectoryPoint(
                positions=[*SQUAT.values()], time_from_start=rospy.Duration(seconds)
            )
        ]
        self.publishers["joint_trajectory"].publish(message)
        self.states.wait(self.is_down, "the squat")
        return [*self.states.messages]

    @staticmethod
    def is_down(state):
        at = dict(zip(state.name, state.position))
        return all(abs(at[name] - position) < 1e-9 for name, position in SQUAT.items())

    def assert_feet_stay(self, states, tolerance=1e-6):
        before = self.feet_of(states[0])
        for state in (*states[1::5], states[-1]):
            np.testing.assert_allclose(self.feet_of(state), before, atol=tolerance)

    def test_a_squat_by_joint_trajectory_leaves_both_feet_in_robot_state(self):
        self.anchor(LEFT)
        states = self.squat()
        self.assert_feet_stay(states)
        heights = [numbers(state.base_pose)[2] for state in states]
        self.assertEqual(heights, sorted(heights, reverse=True))
        self.assertLess(heights[-1], UPRIGHT[2] - 0.05)
        sinking = [
            state.base_twist.linear.z
            for state, height in zip(states, heights)
            if any(state.velocity) and height < UPRIGHT[2] - 0.01  # no longer straight
        ]
        self.assertTrue(sinking, "a busy machine may skip some states")
        self.assertLess(max(sinking), 0.0)

    def test_both_feet_stay_on_tf_too(self):
        """From joints as robot_state_publisher gets them, which may drop some."""
        self.anchor("lowest_foot")
        last = self.squat()[-1].header.stamp
        self.joints.wait(lambda m: m.header.stamp >= last, "the last joints")
        frames = tf2_ros.BufferCore(rospy.Duration(100))
        for message in self.static.messages:
            for edge in message.transforms:
                frames.set_transform_static(edge, "test")

        def has_base():
            for edge in [t for m in [*self.tf.messages] for t in m.transforms]:
                if edge.child_frame_id == "base_link":
                    frames.set_transform(edge, "test")
            return frames.can_transform_core("map", "pelvis", last)[0]

        wait_for(has_base, "the last base")
        joints = [m for m in self.joints.messages if m.header.stamp <= last][1:]
        self.assertGreater(len(joints), 2)

        def feet_at(stamp, positions):
            edge = frames.lookup_transform_core("map", "pelvis", stamp).transform
            t, q = edge.translation, edge.rotation
            base = np.array([t.x, t.y, t.z, q.x, q.y, q.z, q.w])
            return self.feet(joints[0].name, positions, base)

        places = [feet_at(m.header.stamp, m.position) for m in joints]
        np.testing.assert_allclose(places, places[:1] * len(places), atol=1e-3)
        for old, new in zip(joints[::3], joints[1::3]):
            middle = old.header.stamp + (new.header.stamp - old.header.stamp) / 2
            positions = (np.array(old.position) + new.position) / 2
            between = feet_at(middle, positions)
            np.testing.assert_allclose(between, places[0], atol=1e-3)

    def test_a_stream_of_joint_commands_leaves_both_feet(self):
        self.anchor("lowest_foot")
        for fraction in np.linspace(0.0, 1.0, 21):
            bent = [fraction * position for position in SQUAT.values()]
            self.publishers["joint_commands"].publish(
                JointState(name=[*SQUAT], position=bent)
            )
            self.states.wait(
                lambda m, bent=bent: abs(position_of(m, KNEE) - bent[1]) < 1e-9
            )
        self.assert_feet_stay([*self.states.messages])

    def test_a_base_command_moves_the_robot_and_the_foot_stays_there(self):
        self.anchor(RIGHT)
        command = PoseStamped()
        command.pose.position.x, command.pose.position.z = 1.0, 2.0
        command.pose.orientation.w = 1.0
        self.publishers["base_command"].publish(command)
        self.states.wait(lambda m: m.base_pose.position.x == 1.0, "the base")
        self.states.clear()
        self.states.wait()
        states = self.squat()
        self.assertEqual(states[0].base_pose.position.z, 2.0)
        self.assert_feet_stay(states)

    def test_what_is_no_anchor_is_refused_in_a_sentence(self):
        self.anchor(LEFT)
        for link, text in (
            ("left_ankle", "g1_robot has no link 'left_ankle'; known anchors: left_a"),
            ("lowest", "g1_robot has no link 'lowest'; known anchors: lowest_foot, "),
        ):
            answer = self.set_anchor(link_name=link)
            self.assertFalse(answer.success)
            self.assertIn(text, answer.status_message)
        self.assertEqual(self.anchor_now(), LEFT)
        self.assertEqual(self.set_anchor(link_name="").previous, LEFT)
        refused = self.get_anchor("nobody")
        self.assertIn("There is no model 'nobody'", refused.status_message)

    def test_the_command_pose_keeps_a_link_meanwhile(self):
        self.anchor(RIGHT)
        self.squat(0.1)
        self.states.clear()
        self.states.wait()
        words = "zero", "--seconds", 1, "--anchor", "left_rubber_hand"
        self.assertEqual(run_pose(*words), (0, "pose: zero\n", ""))
        self.assertEqual(self.anchor_now(), RIGHT)
        states = [*self.states.messages]
        self.assertFalse(any(states[-1].position))
        hands = [self.hand_of(state) for state in (*states[::5], states[-1])]
        np.testing.assert_allclose(hands, hands[:1] * len(hands), atol=1e-6)
        self.assertNotEqual(numbers(states[-1].base_pose)[2], UPRIGHT[2])

    def hand_of(self, state):
        from oracle import forward_kinematics

        positions = dict(zip(state.name, state.position))
        placed = forward_kinematics(self.urdf, numbers(state.base_pose), positions)
        return placed["left_rubber_hand"]

    def test_a_pose_at_once_keeps_it_too_and_a_refusal_moves_nothing(self):
        self.assertEqual(run_pose("squat", "--anchor", RIGHT), (0, "pose: squat\n", ""))
        self.states.clear()
        bent = POSES["squat"][KNEE]
        self.states.wait(lambda m: abs(position_of(m, KNEE) - bent) < 1e-12)
        after = self.feet_of(self.states.messages[-1])
        before = self.feet(self.names, [0.0] * len(self.names), np.array(UPRIGHT))
        np.testing.assert_allclose(after[1], before[1], atol=1e-6)
        self.assertEqual(self.anchor_now(), "")
        code, output, errors = run_pose("zero", "--anchor", "right_foot")
        self.assertEqual((code, output), (1, ""))
        told = "pose: The anchor was refused: g1_robot has no link 'right_foot'; known "
        self.assertTrue(errors.startswith(told), errors)
        self.assertEqual(len(errors.splitlines()), 1)

    def test_an_interrupt_restores_the_anchor(self):
        self.anchor(RIGHT)
        process = start_pose("squat", "--seconds", 60, "--anchor", LEFT)
        self.addCleanup(process.kill)
        self.states.wait(lambda m: position_of(m, KNEE) > 0.001, "the first steps")
        self.assertEqual(self.anchor_now(), LEFT)
        process.send_signal(signal.SIGINT)
        self.assertEqual(process.communicate(), ("", "pose: interrupted.\n"))
        self.assertEqual(process.returncode, 130)
        self.states.clear()
        self.states.wait(lambda m: not any(m.velocity), "it to stop")
        self.assertLess(position_of(self.states.messages[-1], KNEE), 2.35)
        self.assertEqual(self.anchor_now(), RIGHT)

    def test_play_keeps_a_foot_in_a_motion_without_a_base(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        joints, whole = (
            Path(folder.name, f"{name}.csv") for name in ("joints", "whole")
        )
        rows = [[time, *(time * p for p in SQUAT.values())] for time in (0.0, 0.5, 1.0)]
        base = [f"base_{name}" for name in ("x", "y", "z", "qx", "qy", "qz", "qw")]
        for file, names, more in ((joints, [], []), (whole, base, UPRIGHT)):
            lines = [["time", *names, *SQUAT]]
            lines += [[row[0], *more, *row[1:]] for row in rows]
            file.write_text("\n".join(",".join(map(str, line)) for line in lines))
        played = run("play", joints, "--anchor", "lowest_foot")
        self.assertEqual(played.returncode, 0, played.stderr)
        self.states.wait(self.is_down, "the squat")
        self.assert_feet_stay([*self.states.messages])
        self.assertEqual(self.anchor_now(), "")
        refused = run("play", whole, "--anchor", LEFT)
        told = "play: --anchor needs a motion without a base, but whole.csv has one.\n"
        self.assertEqual(refused.returncode, 2)
        self.assertTrue(refused.stderr.endswith(told), refused.stderr)
