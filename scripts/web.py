#!/usr/bin/env python3
"""Run the node that shows robots in a browser."""

import signal

# While Python is still looking for our code; that answers Ctrl-C itself.
if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
    signal.signal(signal.SIGINT, signal.SIG_DFL)

from g1_description.web.node import main

main()
