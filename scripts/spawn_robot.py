#!/usr/bin/env python3
"""Spawn the robot in Gazebo, in its pose and on its feet."""

import signal

# While Python is still looking for our code; that answers Ctrl-C itself.
if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
    signal.signal(signal.SIGINT, signal.SIG_DFL)

from g1_description.gazebo.programs.spawn_robot import main

main()
