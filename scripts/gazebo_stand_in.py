#!/usr/bin/env python3
"""Run the stand-in for Gazebo."""

from g1_description.ros.gazebo.node import main

main()
