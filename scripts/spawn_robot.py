#!/usr/bin/env python3
"""Spawn the robot in Gazebo, in its pose and on its feet."""

from g1_description.ros.gazebo.programs.spawn_robot import main

main()
