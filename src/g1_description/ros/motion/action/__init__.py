"""The action follow_joint_trajectory."""
