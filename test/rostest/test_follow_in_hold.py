"""Goals of follow_joint_trajectory that motors follow."""

import unittest

import rospy
from control_msgs.msg import FollowJointTrajectoryResult as Result
from std_srvs.srv import Empty
from support.goals import Client, Joints, goal_of, tolerance
from support.ros_testing import wait_for

ELBOW, SHOULDER = "left_elbow_joint", "left_shoulder_pitch_joint"
NEAR = 0.05
"""[rad]"""


class TestFollowInHold(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        rospy.ServiceProxy("/gazebo/unpause_physics", Empty)()  # as it was launched
        cls.joints = Joints()
        cls.joints.next()  # the simulator is there
        cls.client = Client("/follow_joint_trajectory")

    def test_motors_follow_within_tolerances(self):
        for place in (0.5, 0.0):
            goal = goal_of({1.0: {ELBOW: place, SHOULDER: -place}}, [[0.0, 0.0]])
            for name in (ELBOW, SHOULDER):
                goal.path_tolerance += tolerance(name, 2.0 * NEAR)
                goal.goal_tolerance += tolerance(name, NEAR)
            state, result = self.client.run(goal)
            self.assertEqual(state, "SUCCEEDED", result)
            self.assertAlmostEqual(
                self.joints.next().position[ELBOW], place, delta=NEAR
            )

    def test_what_no_motor_does_breaks_the_path_tolerance(self):
        jump = goal_of({0.01: {ELBOW: 1.5}, 1.0: {ELBOW: 1.5}})
        jump.path_tolerance = tolerance(ELBOW, 0.2)
        state, result = self.client.run(jump)
        self.assertEqual(state, "ABORTED", result)
        self.assertEqual(result.error_code, Result.PATH_TOLERANCE_VIOLATED)

    def test_a_cancelled_goal_comes_to_rest(self):
        self.client.run(goal_of({0.5: {ELBOW: 0.0}}))
        self.client.send(goal_of({8.0: {ELBOW: 1.5}}))
        wait_for(lambda: self.joints.next().position[ELBOW] > 0.4, "a bent elbow")
        self.client.cancel()
        self.assertEqual(self.client.end()[0], "PREEMPTED")
        wait_for(lambda: abs(self.joints.next().velocity[ELBOW]) < 0.05, "a rest")
        self.assertLess(self.joints.next().position[ELBOW], 1.2)
