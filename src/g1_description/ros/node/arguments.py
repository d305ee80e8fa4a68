"""The arguments that a node was started with."""

from __future__ import annotations

import sys

import rospy


def own_arguments() -> list[str]:
    """Give this program's arguments without ROS' remappings."""
    return rospy.myargv(sys.argv)[1:]
