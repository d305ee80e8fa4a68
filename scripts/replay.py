#!/usr/bin/env python3
"""Show a motion from a file, without a simulator."""

from g1_description.ros.motion.replay import main

main()
