"""/rosout as in roscpp: not latched.

rospy latches it, so each new subscriber gets the last line again.
Used with ``rospy.init_node(..., disable_rosout=True)``.
"""

from __future__ import annotations

import logging

import rospy
from roscpp.msg import Logger
from roscpp.srv import GetLoggersResponse, SetLoggerLevelResponse
from rosgraph_msgs.msg import Log

ROSOUT_LEVELS = {
    logging.DEBUG: Log.DEBUG,
    logging.INFO: Log.INFO,
    logging.WARNING: Log.WARN,
    logging.ERROR: Log.ERROR,
    logging.CRITICAL: Log.FATAL,
}


class RosoutHandler(logging.Handler):
    """Publishes what is logged."""

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


LEVELS = {
    "debug": logging.DEBUG,
    "info": logging.INFO,
    "warn": logging.WARNING,
    "error": logging.ERROR,
    "fatal": logging.CRITICAL,
}


def answer_as_roscpp() -> None:
    """Replace rospy's answers; to be called before ``rospy.init_node``.

    rospy returns levels in upper case, and ignores an unknown level silently.
    """
    rospy.client._get_loggers = _get_loggers
    rospy.client._set_logger_level = _set_logger_level


def _get_loggers(_) -> GetLoggersResponse:
    """List the loggers with their levels."""
    names = list(logging.Logger.manager.loggerDict)
    return GetLoggersResponse(
        [Logger(name, _level_name(logging.getLogger(name))) for name in names]
    )


def _level_name(logger: logging.Logger) -> str:
    """Name the highest level that is not above a logger's own."""
    level = logger.getEffectiveLevel()
    below = [name for name in LEVELS if LEVELS[name] <= level]
    return max(below, key=LEVELS.get, default="debug")


def _set_logger_level(request) -> SetLoggerLevelResponse:
    """Set a logger's level; the case of its name does not matter.

    Raises:
        ServiceException: If there is no such level.
    """
    level = LEVELS.get(request.level.lower())
    if level is None:
        raise rospy.ServiceException(
            f"unknown level '{request.level}'; levels are {', '.join(LEVELS)}"
        )
    logging.getLogger(request.logger).setLevel(level)
    return SetLoggerLevelResponse()
