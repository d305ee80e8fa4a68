"""Checks on ROS: the node ``checker``."""
