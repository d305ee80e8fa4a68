"""What whoever comes late sees of a robot while time stands still."""

import rospy
import tf2_ros
from sensor_msgs.msg import JointState

from .ros_testing import is_at, uri_of, wait_for
from .wire.raw_subscriber import RawSubscriber

ELBOW, WRIST = "left_elbow_joint", "left_wrist_yaw_link"


class Frames:
    """TF, listened to from now on."""

    def __init__(self):
        self._buffer = tf2_ros.Buffer()
        self._listener = tf2_ros.TransformListener(self._buffer, tcp_nodelay=True)
        wait_for(
            lambda: all(
                self._buffer.can_transform("map", link, rospy.Time())
                for link in (WRIST, "head_link")
            ),
            "the frames",
        )

    def look(self, frame=WRIST):
        """Give the newest transform from the map."""
        return self._buffer.lookup_transform("map", frame, rospy.Time())

    def close(self):
        self._listener.unregister()


def check_that_commands_show(states, commands):
    """Each in joint states and on TF, also for whoever has just come.

    Args:
        states: A listener to joint states.
        commands: The publisher of joint commands.
    """
    # Subscribers of one node share a connection, so this one has its own.
    late = RawSubscriber(uri_of("/link_states_bridge"), "/joint_states", JointState)
    assert ELBOW in JointState().deserialize(late.read()).name
    late.close()
    for position in (0.1, 0.2, 0.3):
        _check_that_a_command_shows(position, states, commands)


def _check_that_a_command_shows(position, states, commands):
    frames = Frames()
    before = frames.look().transform.rotation.y
    commands.publish(JointState(name=[ELBOW], position=[position]))
    states.wait(lambda m: is_at(m, ELBOW, position), f"{position}")
    wait_for(lambda: frames.look().transform.rotation.y != before, "it on TF")
    frames.close()
