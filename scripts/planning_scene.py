#!/usr/bin/env python3
"""Keep the objects of MoveIt in Gazebo."""

import signal

# While Python is still looking for our code; that answers Ctrl-C itself.
if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
    signal.signal(signal.SIGINT, signal.SIG_DFL)

from g1_description.gazebo.programs.planning_scene import main

main()
