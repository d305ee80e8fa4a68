#!/usr/bin/env python3
"""Passes /stepped_clock on to /clock at the rate that gazebo_ros is given.

As in gazebo_ros (noetic), the time of the last message is not taken back when the
simulated time is: then nothing is sent until it is reached again.
"""

import rospy
from rosgraph_msgs.msg import Clock


class Throttle:
    """The last time that was published, and nothing else."""

    def __init__(self):
        self._rate = rospy.get_param("/gazebo/pub_clock_frequency", 0)
        self._last = rospy.Time()
        self._clock = rospy.Publisher("/clock", Clock, queue_size=10)
        rospy.Subscriber("/stepped_clock", Clock, self._stepped)

    def _stepped(self, message):
        passed = (message.clock - self._last).to_sec()
        if self._rate > 0 and passed < 1.0 / self._rate:
            return
        self._last = message.clock
        self._clock.publish(message)


if __name__ == "__main__":
    rospy.init_node("gazebo_clock")
    throttle = Throttle()
    rospy.spin()
