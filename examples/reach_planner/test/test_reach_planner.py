#!/usr/bin/python3
"""The plans are good, a bad one is found, and the robot gets where it shall be."""

import queue
import time
import unittest
from pathlib import Path

import rospkg
import rospy
import rostest
from g1_description.msg import RobotTrajectory
from g1_description.srv import CheckTrajectory
from sensor_msgs.msg import JointState
from trajectory_msgs.msg import JointTrajectory

from g1_description import Robot

DEADLINE = 20.0  # [s]


class TestReachPlanner(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        rospy.init_node("test_reach_planner")
        cls.plans = queue.Queue()
        cls.states = queue.Queue()
        plans = rospy.Subscriber("joint_trajectory", JointTrajectory, cls.plans.put)
        rospy.Subscriber("joint_states", JointState, cls.states.put)
        cls.goals = rospy.Publisher("goal", JointState, queue_size=1)
        rospy.wait_for_service("checker/check_trajectory", DEADLINE)
        cls.check = rospy.ServiceProxy("checker/check_trajectory", CheckTrajectory)
        # What is published before all are connected is lost.
        deadline = time.monotonic() + DEADLINE
        while not (cls.goals.get_num_connections() and plans.get_num_connections()):
            assert time.monotonic() < deadline, "the planner is not there"
            cls.states.get(timeout=DEADLINE)

    def plan(self, **goal):
        """Ask the planner; return its plan."""
        self.goals.publish(JointState(name=list(goal), position=list(goal.values())))
        return self.plans.get(timeout=DEADLINE)

    def verdict(self, plan):
        """Check a plan."""
        response = self.check(trajectory=RobotTrajectory(joint_trajectory=plan))
        self.assertTrue(response.success, response.status_message)
        return response

    def assert_valid(self, plan):
        """Check a plan that shall be valid; leave a page of one that is not."""
        verdict = self.verdict(plan)
        if not verdict.valid:
            page = Path(rospkg.get_test_results_dir(), f"{self.id()}.html")
            robot = Robot()
            motion = robot.from_message(plan)
            robot.write_page(page, motion, robot.check(motion))
            self.fail(f"{[finding.text for finding in verdict.findings]}; see {page}")

    def test_1_a_plan_has_no_fault_and_the_robot_follows_it(self):
        plan = self.plan(left_shoulder_roll_joint=0.8, left_elbow_joint=0.5)
        self.assert_valid(plan)
        self.wait_for("left_shoulder_roll_joint", 0.8)

    def test_2_a_goal_beyond_a_limit_is_found(self):
        plan = self.plan(right_knee_joint=3.2)
        (finding,) = [f for f in self.verdict(plan).findings if f.check == "position"]
        self.assertEqual(finding.subject, ["right_knee_joint"])
        self.assertAlmostEqual(finding.worst, 3.2 - 2.8798, places=3)

    def test_3_an_arm_that_would_hit_the_body_is_found(self):
        plan = self.plan(right_shoulder_roll_joint=0.6, right_shoulder_yaw_joint=1.0)
        verdict = self.verdict(plan)
        self.assertFalse(verdict.valid)
        self.assertIn("self_collision", [f.check for f in verdict.findings])

    def wait_for(self, joint, position):
        """Wait until the robot has a joint at a position."""
        deadline = time.monotonic() + DEADLINE
        while time.monotonic() < deadline:
            state = self.states.get(timeout=DEADLINE)
            if abs(state.position[state.name.index(joint)] - position) < 1e-3:
                return
        self.fail(f"{joint} did not get to {position}")


if __name__ == "__main__":
    rostest.rosrun("reach_planner", "reach_planner", TestReachPlanner)
