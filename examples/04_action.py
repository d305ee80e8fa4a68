"""Move an arm by the action that MoveIt uses."""

import actionlib
import numpy as np
import rospy
from control_msgs.msg import FollowJointTrajectoryAction, FollowJointTrajectoryGoal
from sensor_msgs.msg import JointState

from g1_description import Robot

robot = Robot()
rospy.init_node("action")
action = actionlib.SimpleActionClient(
    "follow_joint_trajectory", FollowJointTrajectoryAction
)
action.wait_for_server()

times = np.linspace(0.1, 1.0, 10)
motion = robot.trajectory(times, {"right_elbow_joint": np.sin(times)})
motion = motion.arranged(["right_elbow_joint"])
goal = FollowJointTrajectoryGoal()
goal.trajectory = robot.trajectory_message(motion).joint_trajectory

state = action.send_goal_and_wait(goal)
print("succeeded:", state == actionlib.GoalStatus.SUCCEEDED)
print("error code:", action.get_result().error_code)
shown = rospy.wait_for_message("joint_states", JointState)
print(f"{shown.position[shown.name.index('right_elbow_joint')]:.4f} rad")
