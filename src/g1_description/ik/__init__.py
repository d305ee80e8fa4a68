"""Whole-body inverse kinematics."""
