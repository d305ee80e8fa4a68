"""The command pose, with the words that a user types."""

import yaml

from .programs import Program
from .ros_testing import PROFILE

POSES = yaml.safe_load((PROFILE / "poses.yaml").read_text())
KNEE = "left_knee_joint"


def start(*words, home=None):
    return Program("pose", *words, environment={"ROS_HOME": str(home)} if home else {})


def run(*words, home=None):
    """Type a command; give its exit code, what it prints and what it complains of.

    What rospy itself says of a connection that its other end gave up is left out.
    """
    process = start(*words, home=home)
    output, errors = process.communicate()
    lines = errors.splitlines(keepends=True)
    own = [line for line in lines if "Inbound TCP/IP connection failed" not in line]
    return process.returncode, output, "".join(own)
