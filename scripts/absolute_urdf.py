#!/usr/bin/env python3
"""Print a URDF file with absolute mesh URIs."""

from g1_description.ros.gazebo.programs.launched_robot import main

main()
