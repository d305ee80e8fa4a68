#!/usr/bin/env python3
"""Run the node with which RViz poses a robot."""

import signal

# While Python is still looking for our code; that answers Ctrl-C itself.
if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
    signal.signal(signal.SIGINT, signal.SIG_DFL)

from g1_description.interactive.node import main

main()
