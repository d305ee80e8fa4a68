"""All that leans on rospy's insides."""
