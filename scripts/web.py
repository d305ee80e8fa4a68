#!/usr/bin/env python3
"""Run the node that shows robots in a browser."""

from g1_description.ros.web.node import main

main()
