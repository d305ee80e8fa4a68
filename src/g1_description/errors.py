"""The one family of errors that core and sim raise.

A message says what was requested and what exists, in one sentence that may be
shown to a user as it is.
"""

from __future__ import annotations


class G1DescriptionError(Exception):
    """Base of all errors this package raises for a caller's mistake."""


class DescriptionError(G1DescriptionError):
    """A robot description cannot be read or makes no robot."""


class NoSuchModelError(DescriptionError):
    """There is no model where one is looked for."""


class ProfileError(DescriptionError):
    """A robot's profile cannot be read, or holds something else."""


class PoseFileError(G1DescriptionError):
    """A file of poses cannot be read, or holds something else."""


class MotionError(G1DescriptionError):
    """A motion cannot be read, or no robot can make it."""


class NoMotionError(MotionError):
    """A file holds something else, such as parameters or a list of files."""


class MotorFileError(DescriptionError):
    """A file of motors cannot be read, or holds something else."""


class NoSuchMotorsError(MotorFileError):
    """A robot has no motors of that name."""


class AllowedPairsError(G1DescriptionError):
    """A file of allowed collisions cannot be read, or is that of another robot."""


class ThresholdError(G1DescriptionError):
    """Thresholds of checks cannot be read, or are none."""


class UnknownNameError(G1DescriptionError):
    """A model, link, joint, frame or pose was requested that does not exist."""


class InvalidValueError(G1DescriptionError):
    """A number was given that no robot can have, such as NaN."""


class ClusterError(G1DescriptionError):
    """Machines that should work together do not answer, or lack libraries."""


class PageServerError(G1DescriptionError):
    """The browser view cannot be opened, or accepts no input."""


class WireFormatError(G1DescriptionError):
    """Bytes that should be a message are not."""


MAX_CAUSE = 200
"""Longest part of another library's message in a sentence of ours, in characters."""


def cause(error: BaseException) -> str:
    """Return the first line of what an error says, or its kind where it says nothing.

    For errors of other libraries, whose messages may have many lines.
    """
    lines = str(error).strip().splitlines() or [type(error).__name__]
    return lines[0].strip().rstrip(".")[:MAX_CAUSE]


class SceneError(G1DescriptionError):
    """A scene cannot be read or written."""
