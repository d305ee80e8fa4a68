"""A program: an ordinary rospy node that commands a joint and tells what it measures.

Usage: planner.py NAME JOINT RATE
       planner.py NAME /clock

It publishes positions of a joint that never fall, RATE times per second (0: none), and
writes a `RECORD` for each message of joint_states, or of the clock.
"""

import struct
import sys
import time

import rospy
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import JointState

STEP = 1e-4
"""From one commanded position to the next, in [rad]."""
RECORD = struct.Struct("<ddd")
"""When a message came, on the monotonic clock in [s]; its stamp in [s]; the position in
[rad], 0 for the clock."""


def tell(stamp, position):
    """Write of a message that has just come."""
    sys.stdout.buffer.write(RECORD.pack(time.monotonic(), stamp, position))
    sys.stdout.buffer.flush()


def tell_the_time(name):
    """Write of each message of the clock, until it is killed."""
    rospy.init_node(name, disable_signals=True)
    rospy.Subscriber(
        "/clock", Clock, lambda m: tell(m.clock.to_sec(), 0.0), tcp_nodelay=True
    )
    rospy.spin()


def main():
    """Run until it is killed."""
    if sys.argv[2] == "/clock":
        tell_the_time(sys.argv[1])
    name, joint, rate = sys.argv[1], sys.argv[2], float(sys.argv[3])
    rospy.init_node(name, disable_signals=True)

    def write(message):
        tell(message.header.stamp.to_sec(), message.position[message.name.index(joint)])

    rospy.Subscriber("/joint_states", JointState, write, tcp_nodelay=True)
    if not rate:
        rospy.spin()
    publisher = rospy.Publisher("/joint_commands", JointState, queue_size=10)
    count = 0
    while True:
        time.sleep(1.0 / rate)
        count += 1
        publisher.publish(JointState(name=[joint], position=[count * STEP]))


if __name__ == "__main__":
    main()
