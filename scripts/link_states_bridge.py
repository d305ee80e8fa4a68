#!/usr/bin/env python3
"""Run the bridge between link states and joint states."""

from g1_description.ros.bridge.node import main

main()
