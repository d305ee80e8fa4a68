"""Compute kinematics and dynamics: where links are, balance, and joint efforts."""

import numpy as np

from g1_description import Robot

robot = Robot()
squat = robot.read_motion("squat.csv")
poses = robot.link_poses(squat.positions, squat.base)
print(f"left hand, at 2.8 s: {poses['left_rubber_hand'][140, :3].round(3)} m")

center = robot.center_of_mass(squat.positions, squat.base)
ankles = 0.5 * (poses["left_ankle_roll_link"] + poses["right_ankle_roll_link"])
ahead = center[:, 0] - ankles[:, 0]
print(f"centre of mass {ahead.min():.3f} to {ahead.max():.3f} m ahead of the ankles")

jacobian = robot.jacobian("left_rubber_hand", squat.positions, squat.base)
rates = np.gradient(squat.positions, squat.times, axis=0)
print(f"Jacobian {jacobian.shape}, fastest joint {np.abs(rates).max():.2f} rad/s")

efforts = robot.inverse_dynamics(robot.named_configuration("t_pose"))
row = robot.joint_row("left_shoulder_roll_joint")
limit = robot.effort_limits[row]
print(f"arm stretched out: {efforts[row]:.2f} of {limit:.0f} N m at the shoulder")
