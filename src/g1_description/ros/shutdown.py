"""How a node ends quietly."""

from __future__ import annotations

from contextlib import contextmanager

import rospy


@contextmanager
def quiet_when_closing():
    """Pass over what publishing raises while rospy closes the topics.

    rospy does so before ``is_shutdown`` turns true.
    """
    try:
        yield
    except rospy.ROSException:
        if not rospy.core.is_shutdown_requested():
            raise
