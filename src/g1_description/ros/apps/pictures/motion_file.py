"""Moments of a motion from a file."""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np

from g1_description.core.errors import InvalidValueError
from g1_description.core.motion.motion import Motion
from g1_description.core.motion.sampling import sample
from g1_description.core.robot.description import Description
from g1_description.ros.motion.files.read import read_motion_file

from .film import check_length, count
from .robot_watch import Moment

SHEET = 6
"""Pictures of a contact sheet whose times are not given."""


def read_moments(
    args: argparse.Namespace, description: Description
) -> tuple[list[list[Moment]], tuple[str, ...]]:
    """Read the moments of a motion that are to be drawn.

    Args:
        args: Of the command line.
        description: The robot.

    Returns:
        What the robot does at each moment, and messages on what does not fit.

    Raises:
        MotionError: If the file holds no motion of this robot.
        InvalidValueError: If a time is not in it, or the film would be too long.
    """
    motion = read_motion_file(
        Path(args.motion), description, args.motion_fps, args.motion_topic
    )
    begin = float(motion.trajectory.times[0])
    moments = _moments(motion, _times(args, begin, motion))
    return [[now.with_joints(args.joints)] for now in moments], motion.notes


def _times(args: argparse.Namespace, begin: float, motion: Motion) -> np.ndarray:
    """Choose the times to draw, in [s] since the beginning."""
    end = motion.trajectory.duration
    if args.is_film:
        whole = max(end - begin, 1.0 / args.fps)
        seconds = whole if args.seconds is None else min(args.seconds, whole)
        check_length(seconds, args.fps, args.size)
        return begin + np.arange(count(seconds, args.fps)) / args.fps
    if args.times is None:
        return np.linspace(begin, end, SHEET if end > begin else 1)
    wrong = [time for time in args.times if not begin <= time <= end]
    if wrong:
        raise InvalidValueError(
            f"The motion has no time {wrong[0]:g} s; it lasts from {begin:g} to "
            f"{end:g} s."
        )
    return np.array(args.times)


def _moments(motion: Motion, times: np.ndarray) -> list[Moment]:
    """Sample a motion."""
    found = sample(motion.trajectory, times)
    names = motion.trajectory.joint_names
    return [
        Moment(
            dict(zip(names, positions.tolist())),
            None if found.base_poses is None else found.base_poses[number],
        )
        for number, positions in enumerate(found.positions)
    ]
