"""What all rostests share: they run as a node."""

import pytest
import rospy


@pytest.fixture(scope="session", autouse=True)
def node():
    """Start the node, under the name that rostest gives it."""
    rospy.init_node("test")
