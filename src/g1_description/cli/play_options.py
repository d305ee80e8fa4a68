"""Options of the command play, without what plays: help needs nothing else."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from g1_description.cli import options
from g1_description.command_line import (
    argument,
    number,
    option,
    own_arguments,
    parse,
    within,
)

MAX_SPEED = 1e3


@dataclass(frozen=True)
class PlayOptions:
    """Play a motion from a file.

    Space pauses and resumes, left and right step by one sample, q and Ctrl-C stop the
    robot.
    """

    file: Path = argument("the motion", options.motion_file, metavar="FILE")
    fps: float | None = options.fps()
    topic: str | None = options.topic()
    order: str | None = options.order()
    format: str | None = options.file_format()
    speed: float = option(
        "playback speed relative to simulated time",
        1.0,
        within(1.0 / MAX_SPEED, MAX_SPEED),
    )
    begin: float | None = option(
        "start time within the motion [s]",
        None,
        number,
        names=("--from",),
        metavar="TIME",
    )
    end: float | None = option(
        "end time within the motion [s]",
        None,
        number,
        names=("--until",),
        metavar="TIME",
    )
    loop: bool = option("start again a second after the end", False)
    lead_in: float = option(
        "time in which the robot moves to the first sample [s]; 0: at once",
        0.0,
        within(0.0, 60.0),
        metavar="SECONDS",
    )
    start_here: bool = option(
        "move the motion so that it starts at the robot's position and yaw; height and "
        "tilt stay",
        False,
    )
    on_floor: bool = option(
        "lift or lower the whole motion so that its lowest point is at height 0", False
    )
    anchor: str | None = options.anchor()
    scene: Path | None = option(
        "scene whose objects links carry at the times of its attachments, in the "
        "simulator of this package",
        None,
        Path,
        metavar="FILE",
        shown="NAME.scene.yaml next to the motion, if it is there",
    )
    namespace: str = options.namespace()
    base_frame: str | None = option(
        "TF frame of the robot's base, for --start-here",
        None,
        str,
        metavar="FRAME",
        shown="base_link, in a namespace NAMESPACE/base_link",
    )


def parsed() -> PlayOptions:
    """Parse the command line; exit with a message if it is wrong."""
    return parse(PlayOptions, "play", own_arguments())
