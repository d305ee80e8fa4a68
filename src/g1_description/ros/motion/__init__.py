"""Whole-body motions on ROS: shown and played."""
