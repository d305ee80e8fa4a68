#!/usr/bin/env python3
"""Run a controller of each joint of a model, with topics of its own."""

import signal

# While Python is still looking for our code; that answers Ctrl-C itself.
if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
    signal.signal(signal.SIGINT, signal.SIG_DFL)

from g1_description.gazebo.programs.joint_controllers import main

main()
