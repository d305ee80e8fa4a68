"""The joints of the loaded robot, read without the package's own reader."""

from xml.etree import ElementTree

import numpy as np
import rospy


def limits():
    """Read the revolute joints from /robot_description.

    Returns:
        Names, and limits in [rad], shape (2, joints): lower, upper.
    """
    urdf = ElementTree.fromstring(rospy.get_param("/robot_description"))
    joints = [j for j in urdf.findall("joint") if j.get("type") == "revolute"]
    bounds = [
        [float(j.find("limit").get(side)) for side in ("lower", "upper")]
        for j in joints
    ]
    return [j.get("name") for j in joints], np.array(bounds).T
