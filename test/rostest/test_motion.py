"""Motions on the robot's topics, as joint_states and TF show them."""

import unittest

import numpy as np
import rospy
import tf2_ros
from g1_description.msg import RobotState, RobotTrajectory
from g1_description.srv import PlayMotion, Step
from genpy import Duration, Time
from geometry_msgs.msg import PoseStamped, Transform
from sensor_msgs.msg import JointState
from std_srvs.srv import Empty
from support.joint_limits import limits
from support.ros_testing import (
    DEADLINE,
    Connected,
    NodeLog,
    is_at,
    position_of,
    step_by,
    wait_for,
)
from tf2_msgs.msg import TFMessage
from trajectory_msgs.msg import (
    JointTrajectory,
    JointTrajectoryPoint,
    MultiDOFJointTrajectoryPoint,
)
from visualization_msgs.msg import MarkerArray

ELBOW, KNEE = "left_elbow_joint", "right_knee_joint"
UPRIGHT = [0.0, 0.0, 0.8, 0.0, 0.0, 0.0, 1.0]
SECOND = 1_000_000_000


def duration(seconds):
    ns = round(seconds * SECOND)
    return Duration(ns // SECOND, ns % SECOND)


def elbow(*points, stamp=None):
    """Make a trajectory of the elbow from pairs of time and position."""
    message = JointTrajectory(joint_names=[ELBOW])
    message.header.stamp = stamp or Time()
    for time, *numbers in points:
        point = JointTrajectoryPoint(time_from_start=duration(time))
        point.positions, point.velocities = numbers[:1], numbers[1:]
        message.points.append(point)
    return message


def whole_body(names, rows, poses, period):
    """Make a motion of joints and base."""
    message = RobotTrajectory()
    joints, base = message.joint_trajectory, message.multi_dof_joint_trajectory
    joints.joint_names, base.joint_names = list(names), ["base"]
    for number, (row, pose) in enumerate(zip(rows, poses)):
        time = duration(number * period)
        joints.points.append(
            JointTrajectoryPoint(positions=list(row), time_from_start=time)
        )
        transform = Transform()
        t, q = transform.translation, transform.rotation
        t.x, t.y, t.z, q.x, q.y, q.z, q.w = pose
        base.points.append(
            MultiDOFJointTrajectoryPoint(transforms=[transform], time_from_start=time)
        )
    return message


class TestMotion(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        step_by(0.005)
        every = {"queue_size": None, "tcp_nodelay": True}
        cls.states = Connected("/joint_states", JointState, **every)
        cls.tf = Connected("/tf", TFMessage, **every)
        cls.log = NodeLog("/link_states_bridge")
        for listener in (cls.states, cls.tf, cls.log):
            cls.addClassCleanup(listener.close)
        cls.publishers = {
            name: rospy.Publisher(f"/{name}", kind, queue_size=100)
            for name, kind in (
                ("joint_trajectory", JointTrajectory),
                ("motion", RobotTrajectory),
                ("base_command", PoseStamped),
                ("joint_commands", JointState),
            )
        }
        for publisher in cls.publishers.values():
            wait_for(publisher.get_num_connections, f"a listener of {publisher.name}")
        cls.call = {
            name: rospy.ServiceProxy(name, kind)
            for name, kind in (
                ("/gazebo/pause_physics", Empty),
                ("/gazebo/unpause_physics", Empty),
                ("/gazebo/reset_simulation", Empty),
                ("/gazebo/step", Step),
                ("/play_motion", PlayMotion),
            )
        }
        for call in cls.call.values():
            call.wait_for_service(DEADLINE)
        cls.states.wait()
        cls.names, (cls.lower, cls.upper) = limits()

    def setUp(self):
        """Begin with a robot at rest at zero, while time runs."""
        self.call["/gazebo/unpause_physics"]()
        # By calls: messages on several topics come in any order.
        zero = RobotTrajectory()
        zero.joint_trajectory.joint_names = self.names
        point = JointTrajectoryPoint(positions=[0.0] * len(self.names))
        zero.joint_trajectory.points = [point]
        for message in (RobotTrajectory(), zero):
            self.assertTrue(self.call["/play_motion"](message).success)
        self.states.clear()
        self.states.wait(lambda m: not any(m.position) and not any(m.velocity))
        self.clear()

    def clear(self):
        self.states.clear()
        self.tf.clear()
        self.log.clear()

    def publish(self, topic, message):
        self.publishers[topic].publish(message)

    def wait_for_position(self, wanted, joint=ELBOW):
        return self.states.wait(
            lambda m: is_at(m, joint, wanted), f"{joint} at {wanted}"
        )

    def wait_for_warning(self, text):
        self.log.wait(lambda m: text in m.msg, f"the warning {text!r}")

    def later(self, seconds=2.0):
        """Give a time that is not over yet, at a whole hundredth of a second."""
        now = self.states.wait().header.stamp.to_nsec()
        ns = (now + round(seconds * SECOND)) // 10_000_000 * 10_000_000
        return Time(ns // SECOND, ns % SECOND)

    def by_stamp(self):
        return {m.header.stamp.to_nsec(): m for m in [*self.states.messages]}

    def test_each_sample_of_joints_and_base_is_shown(self):
        random = np.random.default_rng(3)
        rows = random.uniform(self.lower, self.upper, (30, len(self.names)))
        turns = random.normal(size=(30, 4))
        turns /= np.linalg.norm(turns, axis=1)[:, np.newaxis]
        poses = np.hstack([random.uniform(-1, 1, (30, 3)), turns])
        message = whole_body(self.names, rows, poses, 0.02)
        start = self.later()
        message.joint_trajectory.header.stamp = start
        self.publish("motion", message)
        self.wait_for_position(rows[-1][self.names.index(ELBOW)])
        self.states.wait(lambda m: not any(m.velocity), "the end")
        found, first = self.by_stamp(), start.to_nsec()
        wanted = {first + number * 20_000_000: row for number, row in enumerate(rows)}
        shown = {stamp: found[stamp] for stamp in wanted if stamp in found}
        self.assertTrue(shown, "a busy machine may skip some states")
        wait_for(
            lambda: {e.header.stamp.to_nsec() for e in self.edges()} >= set(shown),
            "each sample on TF",
        )
        for stamp, message in shown.items():
            np.testing.assert_allclose(message.position, wanted[stamp], atol=1e-9)
        for edge in self.edges():
            number = wanted.get(edge.header.stamp.to_nsec())
            if number is not None:
                t, q = edge.transform.translation, edge.transform.rotation
                index = (edge.header.stamp.to_nsec() - first) // 20_000_000
                seen = [t.x, t.y, t.z, q.x, q.y, q.z, q.w]
                np.testing.assert_allclose(seen, poses[index], atol=1e-9)

    def edges(self):
        transforms = [t for m in [*self.tf.messages] for t in m.transforms]
        return [t for t in transforms if t.child_frame_id == "base_link"]

    def test_no_state_mixes_two_samples(self):
        """The elbow and the base move alike, so that they are never apart."""
        rows = np.zeros((50, 2))
        rows[:, 0] = rows[:, 1] = np.linspace(0.0, 0.98, 50)
        poses = np.zeros((50, 7))
        poses[:, 0], poses[:, 2:] = rows[:, 0], (0.8, 0.0, 0.0, 0.0, 1.0)
        self.publish("motion", whole_body((ELBOW, KNEE), rows, poses, 0.01))
        self.wait_for_position(0.98)
        moved = [m for m in self.states.messages if position_of(m, ELBOW) > 0.0]
        self.assertTrue(moved)
        for message in moved:
            elbow_at, knee = (position_of(message, name) for name in (ELBOW, KNEE))
            self.assertAlmostEqual(elbow_at, knee, delta=1e-12)
        at = {s: position_of(m, ELBOW) for s, m in self.by_stamp().items()}
        edges = [e for e in self.edges() if e.header.stamp.to_nsec() in at]
        self.assertTrue(edges)
        for edge in edges:
            x, joint = edge.transform.translation.x, at[edge.header.stamp.to_nsec()]
            if joint > 0.0:
                self.assertAlmostEqual(x, joint, delta=1e-12)

    def test_velocities_are_those_of_the_cubic_and_zero_at_the_end(self):
        start = self.later()
        self.publish(
            "joint_trajectory",
            elbow((0.0, 0.0, 0.0), (0.4, 0.8, 0.0), stamp=start),
        )
        middle = self.wait_for_position(0.8)
        found = self.by_stamp()
        index = self.names.index(ELBOW)
        for stamp, message in found.items():
            s = (stamp - start.to_nsec()) / SECOND / 0.4
            if 0.0 <= s < 1.0:
                self.assertAlmostEqual(
                    message.position[index], 0.8 * (3 - 2 * s) * s * s, delta=1e-9
                )
                self.assertAlmostEqual(
                    message.velocity[index], 12.0 * s * (1 - s), delta=1e-9
                )
        self.assertAlmostEqual(middle.velocity[index], 0.0, delta=1e-9)

    def test_joints_go_to_a_later_first_point_from_where_they_are(self):
        self.publish("joint_trajectory", elbow((0.3, 0.6)))
        self.wait_for_position(0.6)
        found = self.by_stamp()
        seen = [position_of(m, ELBOW) for m in found.values()]
        self.assertEqual(seen, sorted(seen))
        # By the time between: a busy machine may skip some states.
        speeds = np.diff(seen) / (np.diff([*found]) / SECOND)
        self.assertLess(speeds.max(), 5.0)

    def test_a_configuration_is_shown_at_once_also_while_paused(self):
        self.call["/gazebo/pause_physics"]()
        self.clear()
        pose = [0.5, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]
        message = whole_body((ELBOW,), [[0.3]], [pose], 0.0)
        self.publish("motion", message)
        self.wait_for_position(0.3)
        self.tf.wait(
            lambda m: any(self.is_base_at(t, 0.5) for t in m.transforms),
            "the base",
        )

    def test_a_motion_stands_still_while_paused_and_goes_on_by_steps(self):
        self.call["/gazebo/pause_physics"]()
        self.publish("joint_trajectory", elbow((0.0, 0.1), (0.1, 0.3)))
        self.wait_for_position(0.1)
        for steps, wanted in ((10, 0.2), (4, 0.24), (20, 0.3)):
            self.assertTrue(self.call["/gazebo/step"](steps).success)
            self.states.wait(
                lambda m, wanted=wanted: abs(position_of(m, ELBOW) - wanted) < 1e-9
            )

    def test_a_newer_motion_and_a_command_take_their_joints(self):
        self.publish("joint_trajectory", elbow((0.0, 0.0), (60.0, 1.0)))
        self.states.wait(lambda m: position_of(m, ELBOW) > 0.001)
        self.publish("joint_trajectory", elbow((0.0, 0.5), (0.1, 0.6)))
        self.wait_for_position(0.6)
        self.states.clear()
        self.publish("joint_trajectory", elbow((0.0, 0.0), (60.0, 1.0)))
        self.states.wait(lambda m: 0.001 < position_of(m, ELBOW) < 0.1)
        self.publish("joint_commands", JointState(name=[ELBOW], position=[0.9]))
        self.states.wait(lambda m: abs(position_of(m, ELBOW) - 0.9) < 1e-9, "a command")
        self.clear()
        self.assertAlmostEqual(position_of(self.states.wait(), ELBOW), 0.9)

    def test_no_points_stop_the_joints(self):
        self.publish("joint_trajectory", elbow((0.0, 0.0), (60.0, 1.0)))
        self.states.wait(lambda m: position_of(m, ELBOW) > 0.001)
        self.publish("joint_trajectory", elbow())
        index = self.names.index(ELBOW)
        still = self.states.wait(lambda m: m.position[index] and not m.velocity[index])
        self.clear()
        again = self.states.wait()
        self.assertEqual(still.position[index], again.position[index])

    def test_what_is_over_is_told_and_the_rest_of_what_is_not_is_played(self):
        now = self.states.wait().header.stamp
        self.publish(
            "joint_trajectory", elbow((0.0, 0.4), (0.001, 0.5), stamp=Time(0, 1))
        )
        self.wait_for_warning("joint_trajectory of g1_robot: refused: the motion ended")
        self.publish(
            "joint_trajectory", elbow((0.0, -1.0), (0.001, 0.1), (30.0, 0.2), stamp=now)
        )
        self.states.wait(lambda m: position_of(m, ELBOW) > 0.1)
        self.assertTrue(all(position_of(m, ELBOW) >= 0 for m in self.states.messages))

    def test_what_another_clock_has_stamped_is_told(self):
        message = elbow((0.0, 0.4), stamp=Time(1_700_000_000, 0))
        self.publish("joint_trajectory", message)
        self.wait_for_warning("is its stamp from another clock?")

    def test_a_base_command_takes_the_base_from_a_motion(self):
        poses = [[x, 0.0, 0.8, 0.0, 0.0, 0.0, 1.0] for x in (0.0, 1.0)]
        self.publish("motion", whole_body((ELBOW,), [[0.0], [1.0]], poses, 60.0))
        self.states.wait(lambda m: position_of(m, ELBOW) > 0.001)
        command = PoseStamped()
        command.pose.position.x, command.pose.orientation.w = 5.0, 1.0
        self.publish("base_command", command)
        self.tf.wait(lambda m: any(self.is_base_at(t, 5.0) for t in m.transforms))
        before = position_of(self.states.messages[-1], ELBOW)
        self.clear()
        self.states.wait(lambda m: position_of(m, ELBOW) > before, "the elbow")
        self.assertTrue(all(self.is_base_at(edge, 5.0) for edge in self.edges()))

    @staticmethod
    def is_base_at(edge, x):
        found = edge.transform.translation.x
        return edge.child_frame_id == "base_link" and abs(found - x) < 1e-9

    def test_a_reset_ends_a_motion(self):
        self.publish("joint_trajectory", elbow((0.0, 0.5), (60.0, 1.0)))
        self.states.wait(lambda m: position_of(m, ELBOW) > 0.5)
        before = self.states.wait().header.stamp
        self.call["/gazebo/reset_simulation"]()
        self.states.wait(
            lambda m: m.header.stamp < before and not any(m.position), "zero"
        )
        self.clear()
        self.assertEqual(position_of(self.states.wait(), ELBOW), 0.0)

    def test_bad_messages_are_told_in_a_sentence_and_move_nothing(self):
        """Of each topic one; the readers of the messages have all others."""
        lost = whole_body((ELBOW,), [[0.1]], [[0, 0, 1, 0, 0, 0, 1]], 0.0)
        lost.multi_dof_joint_trajectory.header.frame_id = "nowhere"
        flat = PoseStamped()
        flat.pose.position.x = float("nan")
        for topic, message, text in (
            ("joint_trajectory", elbow((0.1, 0.1), (0.1, 0.2)), "must increase"),
            ("motion", lost, "no transform from frame 'nowhere'"),
            (
                "base_command",
                flat,
                "base pose of sample 1 must be within +-1e+09 (got nan)",
            ),
        ):
            with self.subTest(text=text):
                self.publish(topic, message)
                self.wait_for_warning(text)
        self.assertFalse(any(map(any, (m.position for m in self.states.messages))))

    def test_what_is_beyond_a_limit_is_told(self):
        upper = self.upper[self.names.index(ELBOW)]
        self.publish("joint_trajectory", elbow((0.0, 0.0), (0.05, upper + 0.3)))
        self.wait_for_warning(f"clamped to the limits: {ELBOW} from {upper + 0.3:.10g}")
        self.states.wait(
            lambda m: 0.0 < position_of(m, ELBOW) - upper < 0.0011, "the limit"
        )

    def test_a_streamed_sample_beyond_a_limit_is_told_too(self):
        log = NodeLog("/gazebo")
        self.addCleanup(log.close)
        self.publish("joint_trajectory", elbow((0.05, 9.0)))
        log.wait(
            lambda m: f"clamped to the limits: {ELBOW} from 9 to" in m.msg, "a warning"
        )

    def test_a_base_on_its_head_or_below_the_floor_is_told(self):
        """Obeyed all the same, as in Gazebo."""
        self.addCleanup(self.base_at, UPRIGHT)
        self.base_at(UPRIGHT)
        head, deep = PoseStamped(), PoseStamped()
        head.pose.position.z, head.pose.orientation.x = 0.793, 1.0  # w comes first
        deep.pose.position.z, deep.pose.orientation.w = -0.2, 1.0
        for message, text in (
            (head, "the base is upside down (quaternions are x, y, z, w)"),
            (deep, "the base is below the floor, at z = -0.2 m"),
        ):
            with self.subTest(text=text):
                self.publish("base_command", message)
                self.wait_for_warning(f"base_command of g1_robot: {text}")
                self.wait_for_base(message.pose.position.z)

    def test_a_motion_that_begins_on_its_head_is_told_each_time(self):
        self.addCleanup(self.base_at, UPRIGHT)
        pose = [0.0, 0.0, 0.8, 1.0, 0.0, 0.0, 0.0]
        for _ in range(2):
            motion = whole_body((ELBOW,), [[0.0], [0.1]], [pose, pose], 0.01)
            answer = self.call["/play_motion"](motion)
            self.assertTrue(answer.success)
            self.assertIn("the base is upside down", answer.status_message)
            self.wait_for_position(0.1)

    def test_who_turns_over_bit_by_bit_is_left_in_peace(self):
        self.addCleanup(self.base_at, UPRIGHT)
        self.base_at(UPRIGHT)
        for half in np.linspace(0.0, 0.5 * np.pi, 16):
            message = self.base_at(
                [0.0, 0.0, 0.8, np.sin(half), 0.0, 0.0, np.cos(half)]
            )
            self.assertEqual(message, "")

    def test_a_base_that_is_on_the_floor_but_for_rounding_is_left_in_peace(self):
        self.addCleanup(self.base_at, UPRIGHT)
        self.base_at(UPRIGHT)
        half = 0.1 * np.pi  # a pose that the base is not in yet
        turned = [0.0, 0.0, -0.005, 0.0, 0.0, np.sin(half), np.cos(half)]
        self.assertEqual(self.base_at(turned), "")

    def base_at(self, pose):
        """Put the base somewhere; return what was said once it is there."""
        answer = self.call["/play_motion"](whole_body((ELBOW,), [[0.0]], [pose], 0.0))
        self.assertTrue(answer.success)
        self.tf.clear()
        self.tf.wait(
            lambda m: any(
                t.child_frame_id == "base_link"
                and abs(abs(t.transform.rotation.w) - abs(pose[6])) < 1e-6
                for t in m.transforms
            ),
            "the base",
        )
        return answer.status_message

    def wait_for_base(self, z):
        self.tf.wait(
            lambda m: any(
                t.child_frame_id == "base_link" and t.transform.translation.z == z
                for t in m.transforms
            ),
            f"the base at {z}",
        )

    def test_trails_are_where_tf_had_the_links(self):
        trails = Connected("/trails", MarkerArray, queue_size=None)
        self.addCleanup(trails.close)
        frames = tf2_ros.BufferCore(rospy.Duration(100))
        pose = [0.5, 0.1, 0.9, 0.0, 0.0, 0.0, 1.0]
        self.publish("motion", whole_body((ELBOW,), [[0.7]], [pose], 0.0))
        last = trails.wait(
            lambda m: abs(m.markers[0].points[-1].x - 0.5) < 1e-9, "the base"
        )
        wait_for(
            lambda: any(
                t.child_frame_id == "left_wrist_yaw_link"
                for m in [*self.tf.messages]
                for t in m.transforms
                if t.header.stamp >= last.markers[0].header.stamp
            ),
            "TF of that time",
        )
        static = Connected("/tf_static", TFMessage, queue_size=None)
        self.addCleanup(static.close)
        static.wait(lambda m: any(t.child_frame_id == "pelvis" for t in m.transforms))
        static.wait(
            lambda m: any(t.child_frame_id == "logo_link" for t in m.transforms)
        )
        for messages, put in (
            (static.messages, frames.set_transform_static),
            (self.tf.messages, frames.set_transform),
        ):
            for edge in [t for m in [*messages] for t in m.transforms]:
                put(edge, "test")
        for marker in last.markers:
            edge = frames.lookup_transform_core("map", marker.ns, Time())
            t, end = edge.transform.translation, marker.points[-1]
            np.testing.assert_allclose(
                [end.x, end.y, end.z], [t.x, t.y, t.z], atol=1e-9
            )

    def test_robot_state_has_what_is_commanded(self):
        states = Connected("/robot_state", RobotState, queue_size=None)
        self.addCleanup(states.close)

        def commanded(message):
            return dict(zip(message.commanded_name, message.commanded_position))

        self.publish("joint_trajectory", elbow((0.0, 0.0), (0.05, 0.7)))
        states.wait(lambda m: commanded(m).get(ELBOW) == 0.7, "the motion's end")
        self.publish("joint_commands", JointState(name=[KNEE], position=[0.4]))
        both = states.wait(lambda m: commanded(m).get(KNEE) == 0.4, "the command")
        self.assertEqual(commanded(both)[ELBOW], 0.7, "the other one stays")
        base = PoseStamped()
        base.header.frame_id = "map"
        base.pose.position.x, base.pose.position.z = 0.25, 0.9
        base.pose.orientation.w = 1.0
        self.publish("base_command", base)
        states.wait(
            lambda m: m.has_commanded_base and m.commanded_base_pose.position.x == 0.25,
            "the commanded base",
        )

    def test_the_ghost_is_where_the_robot_is_wanted(self):
        wanted = Connected("/commanded_joint_states", JointState, queue_size=None)
        self.addCleanup(wanted.close)
        beyond = self.upper[self.names.index(ELBOW)] + 0.3
        self.publish("joint_commands", JointState(name=[KNEE], position=[0.4]))
        self.publish("joint_trajectory", elbow((0.0, 0.0), (0.05, beyond)))
        found = wanted.wait(
            lambda m: (position_of(m, ELBOW), position_of(m, KNEE)) == (beyond, 0.4),
            "the ghost",
        )
        self.assertEqual(list(found.name), self.names)
        self.tf.wait(
            lambda m: any(
                t.child_frame_id == "ghost/left_elbow_link"
                and t.header.frame_id == "ghost/left_shoulder_yaw_link"
                for t in m.transforms
            ),
            "its frames",
        )
        self.tf.wait(
            lambda m: any(
                (t.header.frame_id, t.child_frame_id) == ("map", "ghost/pelvis")
                for t in m.transforms
            ),
            "its base",
        )

    def test_the_base_goes_where_a_frame_is(self):
        broadcaster = tf2_ros.StaticTransformBroadcaster()
        frame = rospy.wait_for_message("/tf", TFMessage).transforms[0]
        frame.header.frame_id, frame.child_frame_id = "map", "table"
        frame.transform = Transform()
        frame.transform.translation.x = 2.0
        frame.transform.rotation.z = frame.transform.rotation.w = np.sqrt(0.5)
        broadcaster.sendTransform(frame)
        message = PoseStamped()
        message.header.frame_id = "table"
        message.pose.position.x, message.pose.orientation.w = 1.0, 1.0
        self.publish("base_command", message)
        self.tf.wait(
            lambda m: any(
                t.child_frame_id == "base_link"
                and abs(t.transform.translation.x - 2.0) < 1e-9
                and abs(t.transform.translation.y - 1.0) < 1e-9
                and abs(t.transform.rotation.z - np.sqrt(0.5)) < 1e-9
                for t in m.transforms
            ),
            "the base on the table",
        )
