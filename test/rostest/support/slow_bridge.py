"""A bridge that prints what it is asked, and answers when it is told to.

Usage: slow_bridge.py NAMESPACE: serves NAMESPACE/play_motion, prints `play` or `stop`
for each call, and answers it when it has read a line.
"""

import sys
import time

import rospy
from g1_description.srv import PlayMotion, PlayMotionResponse
from sensor_msgs.msg import JointState

PERIOD = 0.02
"""[s] Of the joint states."""


def now():
    """Give a time that goes on whatever the simulator does."""
    return rospy.Time.from_sec(time.monotonic())


def answer(request):
    moves = request.motion.joint_trajectory.points
    print("play" if moves else "stop", flush=True)
    start = now()
    sys.stdin.readline()
    return PlayMotionResponse(True, "", start)


def main(namespace):
    rospy.init_node("slow_bridge", anonymous=True)
    states = rospy.Publisher(f"/{namespace}/joint_states", JointState, queue_size=1)
    rospy.Service(f"/{namespace}/play_motion", PlayMotion, answer)
    message = JointState(name=["left_elbow_joint"], position=[0.0])
    while not rospy.is_shutdown():
        message.header.stamp = now()
        states.publish(message)
        time.sleep(PERIOD)


if __name__ == "__main__":
    main(sys.argv[1])
