#!/usr/bin/env python3
"""A simulator that obeys every command and does nothing."""

import rospy
from gazebo_msgs.srv import SetModelConfiguration, SetModelConfigurationResponse


def main():
    """Run the node."""
    rospy.init_node("answering_node")
    answer = SetModelConfigurationResponse(True, "SetModelConfiguration: success")
    rospy.Service(
        "/gazebo/set_model_configuration", SetModelConfiguration, lambda _: answer
    )
    rospy.spin()


if __name__ == "__main__":
    main()
