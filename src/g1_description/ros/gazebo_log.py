"""/rosout as in roscpp: not latched.

rospy latches it, so each new subscriber gets the last line again.
Used with ``rospy.init_node(..., disable_rosout=True)``.
"""

from __future__ import annotations

import logging

import rospy
from rosgraph_msgs.msg import Log

ROSOUT_LEVELS = {
    logging.DEBUG: Log.DEBUG,
    logging.INFO: Log.INFO,
    logging.WARNING: Log.WARN,
    logging.ERROR: Log.ERROR,
    logging.CRITICAL: Log.FATAL,
}


class RosoutHandler(logging.Handler):
    """Publishes log messages."""

    def __init__(self) -> None:
        super().__init__()
        self._topic = rospy.Publisher("/rosout", Log, queue_size=100)

    def emit(self, record: logging.LogRecord) -> None:
        """Publish a line, unless the node is shutting down."""
        message = Log(
            level=ROSOUT_LEVELS.get(record.levelno, Log.INFO),
            name=rospy.get_name(),
            msg=self.format(record),
            file=record.filename,
            line=record.lineno,
            function=record.funcName,
        )
        message.header.stamp = rospy.get_rostime()
        try:
            self._topic.publish(message)
        except rospy.ROSException:
            if not rospy.core.is_shutdown_requested():
                self.handleError(record)


def publish_log() -> None:
    """Publish rospy's log on /rosout from now on."""
    logging.getLogger("rosout").addHandler(RosoutHandler())
