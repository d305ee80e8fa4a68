#!/usr/bin/env python3
"""Reset and pause the simulator while the robot moves, and watch TF.

Its arguments are how long it takes in [s], how many resets and how many pauses. Prints
as JSON how long TF stood still after each, and what /rosout had of trouble.
"""

import json
import sys
import threading
import time

import numpy as np
import rospy
import tf2_ros
from gazebo_msgs.msg import ModelState
from rosgraph_msgs.msg import Log
from std_srvs.srv import Empty

from bench.motion import TIMEOUT, Commands, revolute, robot, swing
from bench.nodes import wait_for
from bench.transforms import TROUBLE

LINK = "left_wrist_yaw_link"
PERIOD = 0.02  # [s] from one sample of the motion to the next
LOOK = 0.002  # [s] from one look at TF to the next
PAUSE = 1.0  # [s]
NEVER = 10.0  # [s] after which TF is given up
SLACK = 200_000_000  # [ns] that simulated time may be ahead of wall time


class Watcher:
    """Sees whether TF moves on."""

    def __init__(self):
        """Listen."""
        self.buffer = tf2_ros.Buffer()
        self._listener = tf2_ros.TransformListener(self.buffer)
        self.trouble = []
        rospy.Subscriber("/rosout", Log, self._take, queue_size=1000)

    def _take(self, message):
        """Keep lines of trouble."""
        if any(word in message.msg for word in TROUBLE):
            self.trouble.append(f"{message.name}: {message.msg}")

    def stamp(self):
        """Give the stamp of the newest transform in [ns]; 0 where there is none."""
        try:
            found = self.buffer.lookup_transform("map", LINK, rospy.Time())
        except tf2_ros.TransformException:
            return 0
        return found.header.stamp.to_nsec()

    def wait(self, since, is_new):
        """Wait until two stamps that are new have come.

        Args:
            since: Moment on the monotonic clock in [s].
            is_new: Tells whether a stamp in [ns] is.

        Returns:
            Time since then in [s]; ``NEVER`` if they did not come.
        """
        first = 0
        while time.monotonic() < since + NEVER:
            stamp = self.stamp()
            if stamp and is_new(stamp):
                if first and stamp > first:
                    return time.monotonic() - since
                first = first or stamp
            time.sleep(LOOK)
        return NEVER


def keep_moving(stopped):
    """Send base and joints, one sample after another, until it is stopped."""
    joints = revolute(robot())
    commands = Commands([joint.name for joint in joints])
    base = rospy.Publisher("/gazebo/set_model_state", ModelState, queue_size=100)
    motion = swing(joints, 10.0, 1.0 / PERIOD)
    number = 0
    while not stopped.wait(PERIOD):
        state = ModelState(model_name="g1_robot", reference_frame="world")
        state.pose.position.x = 0.1 * np.sin(PERIOD * number)
        state.pose.position.z = 0.8
        state.pose.orientation.w = 1.0
        base.publish(state)
        commands.send(motion[number % len(motion)])
        number += 1


def reset(watcher, service):
    """Reset once; give how long TF stood still after the answer in [s]."""
    start = time.monotonic()
    service()
    answered = time.monotonic()

    def is_new(stamp):
        return stamp < 1e9 * (time.monotonic() - start) + SLACK

    return watcher.wait(answered, is_new)


def pause(watcher, stop, go_on):
    """Pause and go on once; give how long TF stood still after the answer in [s]."""
    stop()
    time.sleep(PAUSE)
    last = watcher.stamp()
    go_on()
    # While time stands still stamps are a nanosecond apart.
    return watcher.wait(time.monotonic(), lambda stamp: stamp > last + 1_000_000)


def main():
    """Run the node."""
    seconds, resets, pauses = (float(word) for word in rospy.myargv()[1:])
    rospy.init_node("tf_watcher")
    watcher, stopped = Watcher(), threading.Event()
    wait_for(watcher.stamp, "TF", TIMEOUT)
    threading.Thread(target=keep_moving, args=[stopped], daemon=True).start()
    calls = {
        name: rospy.ServiceProxy(f"/gazebo/{name}", Empty)
        for name in ("reset_simulation", "pause_physics", "unpause_physics")
    }
    stop, go_on = calls["pause_physics"], calls["unpause_physics"]
    # Resets and pauses take turns, as long as there are pauses.
    times, begin = {"reset": [], "pause": []}, time.monotonic()
    count = int(resets + pauses)
    for number in range(count):
        moment = begin + seconds * (number + 0.5) / count
        stopped.wait(max(0.0, moment - time.monotonic()))
        if number % 2 == 1 and len(times["pause"]) < pauses:
            times["pause"].append(pause(watcher, stop, go_on))
        else:
            times["reset"].append(reset(watcher, calls["reset_simulation"]))
    stopped.wait(max(0.0, begin + seconds - time.monotonic()))
    stopped.set()
    print(json.dumps({**times, "trouble": watcher.trouble}))


if __name__ == "__main__":
    sys.exit(main())
