"""A motion from a file of any format, rosbags too."""

from __future__ import annotations

from pathlib import Path

from g1_description.errors import MotionError
from g1_description.motion.files.bag import read_bag
from g1_description.motion.files.read import BAG, beginning, read_motion, without_rate
from g1_description.motion.motion import Motion, fitted
from g1_description.robot.description import Description


def read_motion_file(
    path: Path,
    robot: Description,
    rate: float | None = None,
    topic: str | None = None,
) -> Motion:
    """Read a motion of a robot from a file.

    Args:
        path: CSV, npz, pickle, YAML of a JointTrajectory, or rosbag.
        robot: The robot; joints that it does not have are left out, with a note.
        rate: Samples per second of a file without times.
        topic: Topic of a bag with the joints; None: the usual one.

    Raises:
        MotionError: If there is no such file, or no motion in it that fits.
    """
    if beginning(path, len(BAG)) != BAG:
        if topic is not None:
            raise MotionError(f"{path.name} is no bag: it has no topic {topic}.")
        return read_motion(path, robot, rate)
    try:
        return fitted(without_rate(read_bag(path, robot, topic), rate), robot)
    except MotionError as error:
        raise MotionError(f"{path.name}: {error}") from error
    except OSError as error:
        raise MotionError(f"{path} cannot be read: {error.strerror}.") from error
