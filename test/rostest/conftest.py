"""What all rostests share: they run as a node."""

import os

import pytest
import rospy
from support.pages import opened_page


@pytest.fixture(scope="session", autouse=True)
def node(tmp_path_factory):
    """Start the node, under the name that rostest gives it.

    It and what the tests start log into a folder of their own: nodes that start at the
    same moment say that they cannot link the latest one, and what they say is tested.
    """
    os.environ["ROS_LOG_DIR"] = str(tmp_path_factory.mktemp("log") / "run")
    rospy.init_node("test")


@pytest.fixture(scope="session")
def home(tmp_path_factory):
    """Give what the page takes for ROS_HOME."""
    return tmp_path_factory.mktemp("home")


@pytest.fixture(scope="session")
def address(home):
    """Start the page of the robot that runs; give its address."""
    with opened_page(home) as found:
        yield found
