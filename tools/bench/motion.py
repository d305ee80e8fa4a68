"""What the programs of busy parts move."""

import numpy as np
import rospy
from sensor_msgs.msg import JointState

from g1_description.robot.urdf import parse_urdf

AMPLITUDE = 0.3  # [rad]
FREQUENCY = 0.5  # [Hz]
APART = 1e-4  # [rad] from one sample to the next, at least, for the last joint
TIMEOUT = 30.0  # [s]


def revolute(description):
    """List the joints of a robot that turn between limits."""
    return [j for j in description.movable_joints if j.kind == "revolute"]


def robot():
    """Read the robot that runs."""
    return parse_urdf(rospy.get_param("/robot_description"))


def swing(joints, seconds, rate):
    """Let all joints swing smoothly, each at its own phase, no sample like another.

    Args:
        joints: Joints with limits.
        seconds: How long it takes; it begins and ends at rest.
        rate: Samples a second.

    Returns:
        Positions in [rad], shape (n, n_joints).
    """
    lower, upper = np.array([(j.lower, j.upper) for j in joints]).T
    n = round(seconds * rate)
    t = np.arange(n)[:, np.newaxis] / rate
    phase = 2.0 * np.pi * FREQUENCY * t + 0.7 * np.arange(len(joints))
    envelope = np.sin(np.pi * t / seconds) ** 2
    middle = np.clip(0.0, lower + AMPLITUDE, upper - AMPLITUDE)
    positions = middle + AMPLITUDE * envelope * np.sin(phase)
    positions[:, -1] = middle[-1] + APART * np.arange(n)
    return np.clip(positions, lower, upper)


class Commands:
    """Where positions of joints are sent to."""

    def __init__(self, names):
        """Advertise the topic; ``names`` are those of the joints."""
        self._names = names
        self._publisher = rospy.Publisher("/joint_commands", JointState, queue_size=100)

    @property
    def is_heard(self):
        """Whether the bridge listens."""
        return self._publisher.get_num_connections() > 0

    def send(self, position):
        """Send positions in [rad], shape (n_joints,)."""
        self._publisher.publish(JointState(name=self._names, position=list(position)))


def write_motion(file):
    """Write a motion of 8 s: knees and arms go up and down, and the base with them."""
    times = np.arange(0.0, 8.0, 1.0 / 50.0)
    swing = 0.5 - 0.5 * np.cos(2.0 * np.pi * times / 4.0)
    columns = {
        "time": times,
        "base_x": 0.0 * times,
        "base_y": 0.0 * times,
        "base_z": 0.8 - 0.1 * swing,
        "base_qx": 0.0 * times,
        "base_qy": 0.0 * times,
        "base_qz": 0.0 * times,
        "base_qw": 1.0 + 0.0 * times,
    }
    for side in ("left", "right"):
        columns[f"{side}_hip_pitch_joint"] = -0.4 * swing
        columns[f"{side}_knee_joint"] = 0.8 * swing
        columns[f"{side}_ankle_pitch_joint"] = -0.4 * swing
        columns[f"{side}_shoulder_pitch_joint"] = -0.9 * swing
    header = ",".join(columns)
    rows = np.stack([*columns.values()], axis=1)
    np.savetxt(file, rows, delimiter=",", header=header, comments="", fmt="%.6f")
