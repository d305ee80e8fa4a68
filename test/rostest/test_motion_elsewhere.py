"""Motions on a simulator that only takes configurations, as the real Gazebo.

It is the stand-in, whose own service and topics for motions are out of sight.
"""

import unittest

import rospy
import rosservice
from g1_description.msg import RobotTrajectory
from g1_description.srv import SetAnchor
from geometry_msgs.msg import Transform
from sensor_msgs.msg import JointState
from std_srvs.srv import Empty
from support.goals import Client, goal_of, tolerance
from support.programs import Program
from support.ros_testing import DEADLINE, Connected, is_at, position_of, wait_for
from support.stand_in import Node
from tf2_msgs.msg import TFMessage
from trajectory_msgs.msg import JointTrajectoryPoint, MultiDOFJointTrajectoryPoint

ELBOW, KNEE = "left_elbow_joint", "right_knee_joint"


def motion(*samples):
    """Make a motion of elbow, knee and base from pairs of time and position."""
    message = RobotTrajectory()
    message.joint_trajectory.joint_names = [ELBOW, KNEE]
    message.multi_dof_joint_trajectory.joint_names = ["base"]
    for time, at in samples:
        since = rospy.Duration(time)
        transform = Transform()
        transform.translation.x, transform.translation.z = at, 0.8
        transform.rotation.w = 1.0
        message.joint_trajectory.points.append(
            JointTrajectoryPoint(positions=[at, at], time_from_start=since)
        )
        message.multi_dof_joint_trajectory.points.append(
            MultiDOFJointTrajectoryPoint(transforms=[transform], time_from_start=since)
        )
    return message


class TestMotionElsewhere(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        hidden = (
            f"/gazebo/{name}:=/hidden/{name}"
            for name in ("set_model_trajectory", "simulator_state")
        )
        cls.world = Node(*hidden, "_link_states_rate:=50", "_pub_clock_frequency:=50")
        cls.addClassCleanup(cls.world.close)
        bridge = Program("link_states_bridge.py")
        cls.addClassCleanup(bridge.wait)
        cls.addClassCleanup(bridge.terminate)
        cls.states = Connected("/joint_states", JointState, queue_size=None)
        cls.tf = Connected("/tf", TFMessage, queue_size=None)
        for listener in (cls.states, cls.tf):
            cls.addClassCleanup(listener.close)
        cls.motion = rospy.Publisher("/motion", RobotTrajectory, queue_size=10)
        cls.commands = rospy.Publisher("/joint_commands", JointState, queue_size=10)
        for publisher in (cls.motion, cls.commands):
            wait_for(publisher.get_num_connections, f"a listener of {publisher.name}")
        cls.reset = rospy.ServiceProxy("/gazebo/reset_simulation", Empty)
        cls.reset.wait_for_service(DEADLINE)
        cls.states.wait()

    def setUp(self):
        for start in (0.05, 0.0):  # a robot at zero would not show that it was told
            self.states.clear()
            self.motion.publish(motion((0.0, start)))
            self.states.wait(self.is_at(start), f"a robot at {start}")
        self.states.clear()
        self.tf.clear()

    @staticmethod
    def is_at(start):
        """Make a test whether the moved joints, and no others, are somewhere."""
        moved = [start] * 2 if start else []
        return lambda m: [round(at, 9) for at in m.position if at] == moved

    def elbow(self):
        return [position_of(m, ELBOW) for m in [*self.states.messages]]

    def test_the_simulator_cannot_play(self):
        self.assertNotIn("/gazebo/set_model_trajectory", rosservice.get_service_list())

    def test_an_anchor_is_refused_in_a_sentence(self):
        answer = rospy.ServiceProxy("/set_anchor", SetAnchor)(link_name="pelvis")
        told = "the simulator has no anchors; use the simulator of this package"
        self.assertEqual((answer.success, answer.status_message), (False, told))

    def test_a_motion_is_shown_from_its_beginning_to_its_end(self):
        self.motion.publish(motion((0.0, 0.1), (2.0, 0.6), (3.0, 0.05)))
        self.states.wait(lambda m: is_at(m, ELBOW, 0.05), "the end")
        seen = self.elbow()
        peak = seen.index(max(seen))
        self.assertGreater(seen[peak], 0.5)
        self.assertEqual(seen[:peak], sorted(seen[:peak]))
        self.assertEqual(seen[peak:], sorted(seen[peak:], reverse=True))
        self.assertGreater(len(set(seen)), 20)
        self.tf.wait(
            lambda m: any(
                t.child_frame_id == "base_link"
                and abs(t.transform.translation.x - 0.05) < 1e-9
                for t in m.transforms
            ),
            "the base at its end",
        )

    def test_a_command_takes_its_joint(self):
        self.motion.publish(motion((0.0, 0.1), (60.0, 0.7)))
        self.states.wait(lambda m: position_of(m, ELBOW) > 0.1)
        self.commands.publish(JointState(name=[ELBOW], position=[0.9]))
        self.states.wait(lambda m: abs(position_of(m, ELBOW) - 0.9) < 1e-9, "a command")
        before = position_of(self.states.messages[-1], KNEE)
        self.states.clear()
        self.states.wait(lambda m: position_of(m, KNEE) > before, "the knee")
        self.assertTrue(all(abs(at - 0.9) < 1e-9 for at in self.elbow()))

    def test_a_goal_of_the_action_is_reached(self):
        client = Client("/follow_joint_trajectory")
        state, result = client.run(
            goal_of(
                {0.2: {ELBOW: 0.4}, 0.5: {ELBOW: 0.6}},
                goal_tolerance=tolerance(ELBOW, 1e-6),
                goal_time_tolerance=rospy.Duration(DEADLINE),
            )
        )
        self.assertEqual(state, "SUCCEEDED", result)
        self.states.wait(lambda m: is_at(m, ELBOW, 0.6), "the end")
        client.send(goal_of({60.0: {ELBOW: 0.0}}))
        client.wait_until_active()
        self.commands.publish(JointState(name=[ELBOW], position=[0.9]))
        self.assertEqual(client.end()[0], "PREEMPTED")

    def test_a_stop_and_a_reset_end_it(self):
        for end in (lambda: self.motion.publish(RobotTrajectory()), self.reset):
            self.motion.publish(motion((0.0, 0.1), (60.0, 0.7)))
            self.states.wait(lambda m: position_of(m, ELBOW) > 0.1)
            end()
            same = []

            def rests(message, same=same):
                """Whether it has been the same for a second."""
                if same and same[-1] != message.position:
                    same.clear()
                same.append(message.position)
                return len(same) == 50

            self.states.clear()
            self.states.wait(rests, "a rest")
