"""Nodes and programs: the only layer that knows rospy."""
