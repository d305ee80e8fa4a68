"""The nodes: where rospy and messages meet core and sim."""
