#!/usr/bin/env python3
"""Run the node that judges configurations and motions."""

from g1_description.ros.checks.node import main

main()
