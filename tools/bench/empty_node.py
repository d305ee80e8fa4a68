#!/usr/bin/env python3
"""What rospy alone costs: take the bytes of link_states, publish what is ready.

It subscribes as the bridge does, and answers each message with one and the same.
"""

import rospy
from sensor_msgs.msg import JointState


def main():
    """Run the node."""
    rospy.init_node("empty_node")
    names = rospy.get_param("/joint_names")
    ready = JointState(name=names, position=[0.1] * len(names))
    ready.velocity = ready.position
    publisher = rospy.Publisher("joint_states", JointState, queue_size=100)
    rospy.Subscriber(
        "/gazebo/link_states",
        rospy.AnyMsg,
        lambda message: publisher.publish(ready),
        queue_size=100,
        buff_size=1 << 20,
        tcp_nodelay=True,
    )
    rospy.spin()


if __name__ == "__main__":
    main()
