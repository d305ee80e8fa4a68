"""The services get_loggers and set_logger_level as roscpp answers them."""

from __future__ import annotations

import logging

import rospy
from roscpp.msg import Logger
from roscpp.srv import GetLoggersResponse, SetLoggerLevelResponse

LEVELS = {
    "debug": logging.DEBUG,
    "info": logging.INFO,
    "warn": logging.WARNING,
    "error": logging.ERROR,
    "fatal": logging.CRITICAL,
}


def answer_as_roscpp() -> None:
    """Replace rospy's answers; to be called before ``rospy.init_node``.

    rospy names levels in upper case, and says nothing of a level that it does not know.
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
            f"there is no level '{request.level}'; there are {', '.join(LEVELS)}"
        )
    logging.getLogger(request.logger).setLevel(level)
    return SetLoggerLevelResponse()
