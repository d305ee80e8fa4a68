"""A robot for Python programs."""

from __future__ import annotations

from .checks import RobotChecks


class Robot(RobotChecks):
    """A robot, and what can be computed of it.

    Everywhere, ``positions`` may be arrays or dictionaries by joint (see the method
    ``positions``), with any number of leading axes for many configurations at once.
    ``base`` is the pose of the base link in the world, shape (..., 7); by default the
    world's origin.
    """
