"""What any rospy node of ours needs; nothing of Gazebo or the G1."""
