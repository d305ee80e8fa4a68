"""A command that plays a motion from a file on a robot that runs."""

from __future__ import annotations

import contextlib
import os
import re
import select
import sys
import termios
import tty
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import rospy

from g1_description.cli import options
from g1_description.command_line import argument, number, option, parse, say, within
from g1_description.errors import (
    G1DescriptionError,
    InvalidValueError,
    MotionError,
)
from g1_description.motion.edit import cut, moved, to_start_at
from g1_description.motion.files.formats import read_motion
from g1_description.motion.trajectory import Trajectory
from g1_description.robot.transform import IDENTITY
from g1_description.ros.lifecycle import own_arguments, start_node
from g1_description.ros.map_frame import MapFrame
from g1_description.ros.playing import Session
from g1_description.ros.robot_view import RobotView
from g1_description.ros.waiting import NoAnswerError, wait_until
from g1_description.sim.standing import lowest_height
from g1_description.text import listed

KEYS = {
    b" ": "space",
    b"q": "q",
    b"\x1b[C": "right",
    b"\x1b[D": "left",
    b"\x1bOC": "right",
    b"\x1bOD": "left",
}
"""Names of the keys that mean something, by what a terminal sends."""

END = "q"
"""What is read when the terminal is gone."""

ONE_KEY = re.compile(rb"\x1b(?:\[[0-?]*[ -/]*[@-~]|O[@-~])|[^\x1b]", re.DOTALL)
"""What a terminal sends for one key."""

PART_OF_KEY = re.compile(rb"\x1b(?:\[[0-?]*[ -/]*|O)?\Z")
"""The beginning of that, or the key Escape."""


class Keyboard:
    """Reads keys from a terminal one by one; without a terminal there are none."""

    def __init__(self, descriptor: int | None) -> None:
        self._descriptor = descriptor
        self._pending = b""
        if descriptor is not None:
            self._before = termios.tcgetattr(descriptor)
            tty.setcbreak(descriptor)

    def next_key(self, timeout: float) -> str:
        """Wait for a key.

        Args:
            timeout: Longest wait in [s].

        Returns:
            Its name in ``KEYS``, ``END`` when the terminal is gone; empty if there was
            no key that means something.
        """
        name = self._take()
        if name:
            return name
        descriptors = [] if self._descriptor is None else [self._descriptor]
        if not select.select(descriptors, [], [], timeout)[0]:
            self._pending = b""  # of a key that would be here by now
            return ""
        sent = self._read()
        self._pending += sent
        return self._take() if sent else END

    def _read(self) -> bytes:
        """Read what is there; nothing is there when the terminal is gone."""
        assert self._descriptor is not None
        try:
            return os.read(self._descriptor, 1024)
        except OSError:
            return b""

    def _take(self) -> str:
        """Take the first known key of what was read; return its name, or nothing."""
        while self._pending and not PART_OF_KEY.match(self._pending):
            key = ONE_KEY.match(self._pending)
            length = key.end() if key else 1
            taken, self._pending = self._pending[:length], self._pending[length:]
            if taken in KEYS:
                return KEYS[taken]
        return ""

    def close(self) -> None:
        """Let the terminal be as it was; from any thread, and as often as you like."""
        # From the background it would stop this program.
        if self._descriptor is not None and not _is_in_background(self._descriptor):
            with contextlib.suppress(termios.error):  # it may be gone
                # Without a wait for what was printed: Ctrl-S holds that back.
                termios.tcsetattr(self._descriptor, termios.TCSANOW, self._before)


def terminal() -> int | None:
    """Return the terminal whose keys are for this program; None: there is none."""
    if not sys.stdin.isatty():
        return None
    descriptor = sys.stdin.fileno()
    return None if _is_in_background(descriptor) else descriptor


def _is_in_background(descriptor: int) -> bool:
    """Return whether a terminal has another program in its foreground."""
    try:
        return os.getpgrp() != os.tcgetpgrp(descriptor)
    except OSError:  # it does not start programs for this session, or is gone
        return False


TIMEOUT = 30.0
"""Longest wait for the bridge, in [s]: machines may be busy."""

BASE_TIMEOUT = 2.0
"""Longest wait for the robot's base, in [s]."""

REFRESH_PERIOD = 0.05
"""Time between two looks at the progress, in [s]."""

MAX_SPEED = 1e3
MAX_LEAD_IN = 60.0

TOLERANCE = 0.1
"""Largest distance of a joint from the end of its motion, in [rad] or [m]: motors give
way."""

END_TIME = 1_000_000_000
"""Time in which motors must have come to the end of a motion, in [ns]."""

BAR = 24
"""Length of the progress bar, in characters."""


@dataclass(frozen=True)
class PlayOptions:
    """Play a motion from a file.

    Space pauses and resumes, the arrows left and right step by one sample, q and Ctrl-C
    leave the robot where it is.
    """

    file: Path = argument("the motion", Path, metavar="FILE")
    fps: float | None = options.fps()
    topic: str | None = options.topic()
    speed: float = option(
        "seconds of the motion in a second of simulated time",
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
        "end time within the motion [s]", None, number, names=("--to",), metavar="TIME"
    )
    loop: bool = option("start again a second after the end", False)
    lead_in: float = option(
        "time in which the robot moves to the first sample [s]; 0: at once",
        0.0,
        within(0.0, MAX_LEAD_IN),
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
    namespace: str = options.namespace()
    base_frame: str | None = option(
        "TF frame of the robot's base, for --start-here",
        None,
        str,
        metavar="FRAME",
        shown="base_link, in a namespace NAMESPACE/base_link",
    )


def notify(text: str) -> None:
    """Print a message in a line of its own."""
    begin = "\r\x1b[K" if sys.stdout.isatty() else ""
    say(f"{begin}play: {text}")


def prepare(args: PlayOptions, robot: RobotView) -> Trajectory:
    """Read the motion and move it where it is wanted.

    Raises:
        MotionError: If the file holds no motion of the robot.
        InvalidValueError: If it has no such part, or no base to move.
        NoAnswerError: If there is no master.
    """
    motion = read_motion(args.file, robot.description, args.fps, args.topic)
    for note in motion.notes:
        notify(note)
    trajectory = cut(motion.trajectory, args.begin, args.end)
    wanted = [args.start_here and "--start-here", args.on_floor and "--on-floor"]
    if trajectory.base_poses is None and any(wanted):
        names = " and ".join(filter(None, wanted))
        raise InvalidValueError(f"{args.file.name} does not move the base: no {names}.")
    if args.start_here:
        trajectory = to_start_at(trajectory, base_pose(robot, args.base_frame))
    if args.on_floor:
        lowest = lowest_height(robot.description, trajectory)
        T_map_motion = IDENTITY.copy()
        T_map_motion[2] = -lowest
        trajectory = moved(trajectory, T_map_motion)
        notify(f"moved by {-lowest:+.4f} m in height.")
    return trajectory


def base_pose(robot: RobotView, frame: str | None) -> np.ndarray:
    """Return where the robot's base is in the map, shape (7,).

    Args:
        robot: The robot.
        frame: Another base on TF; None: that of the robot's state.

    Raises:
        MotionError: If that is not known.
    """
    if frame:
        return MapFrame().pose_in_map(IDENTITY, frame, rospy.Time())

    def has_base() -> bool:
        return robot.state is not None and robot.state.base_pose is not None

    if not wait_until(has_base, BASE_TIMEOUT):
        raise MotionError(f"{robot.no_base}; --base-frame names its base on TF.")
    return robot.state.base_pose


def progress(session: Session, speed: float) -> str:
    """Return a line that shows where the motion is."""
    begin, end, time = session.begin, session.end, session.time
    share = (time - begin) / (end - begin) if end > begin else 1.0
    done = round(share * BAR)
    bar = "#" * done + "." * (BAR - done)
    frames = f"sample {session.frame} of {len(session.trajectory.times)}"
    state = "" if session.is_running else "  paused"
    rate = "" if speed == 1.0 else f"  x {speed:g}"
    return f"[{bar}] {time:6.2f} of {end:.2f} s  {frames}{rate}{state}"


def follow(session: Session, keyboard: Keyboard, args: PlayOptions) -> None:
    """Play until the end, or until a person ends it.

    Raises:
        NoAnswerError: If the robot is reset, or nobody answers.
        ROSInterruptException: If a signal ends it.
    """
    shows = sys.stdout.isatty()
    _check_signals()
    session.start()
    while True:
        key = keyboard.next_key(REFRESH_PERIOD)
        _check_signals()
        if key == END:
            session.pause()
            break
        if key == "space":
            session.toggle()
        elif key in ("left", "right"):
            session.step(1 if key == "right" else -1)
        if shows:
            line = progress(session, args.speed)
            print(f"\r\x1b[K{line}", end="", flush=True)
        if session.is_over:
            if not args.loop:
                break
            session.restart_when_rested()
    if shows:
        print()


def _check_signals() -> None:
    """Raise ROSInterruptException if a signal ends the node."""
    if rospy.core.is_shutdown_requested():
        raise rospy.ROSInterruptException("interrupted")


def play(args: PlayOptions) -> None:
    """Play a motion.

    Raises:
        G1DescriptionError: If it cannot be played.
    """
    if not args.file.exists():
        raise InvalidValueError(f"There is no file {args.file}.")
    start_node("play", anonymous=True, disable_rosout=True)
    robot = RobotView(args.namespace, notify)
    if not robot.wait_until(lambda: robot.state, TIMEOUT):
        raise NoAnswerError(f"The robot's state is unknown: {robot.silence}")
    trajectory = prepare(args, robot)
    session = Session(robot, trajectory, args.speed, notify, args.lead_in)
    with closing(Keyboard(terminal())) as keyboard:
        # While the node can still call: afterwards the robot would go on.
        rospy.core.add_preshutdown_hook(lambda _: _leave(robot, keyboard))
        follow(session, keyboard, args)
    if session.is_over:
        _check_end(robot, trajectory, args.file.name)
        notify(f"{args.file.name}: {session.end - session.begin:.2f} s played.")


def _check_end(robot: RobotView, trajectory: Trajectory, name: str) -> None:
    """Check that the robot ends where the motion does.

    Raises:
        NoAnswerError: If it does not.
    """
    last = dict(zip(trajectory.joint_names, trajectory.positions[-1].tolist()))
    known = robot.positions
    goal = {
        joint.name: min(max(last[joint.name], joint.lower), joint.upper)
        for joint in robot.description.movable_joints
        if joint.name in last and joint.name in known
    }
    end_ns = robot.now_ns + END_TIME

    def is_settled() -> bool:
        return not robot.away(goal, TOLERANCE) or robot.now_ns > end_ns

    robot.wait_until(is_settled, TIMEOUT)
    away = robot.away(goal, TOLERANCE)
    if away:
        raise NoAnswerError(
            f"{name} is over, but the robot is elsewhere: {listed(away)}. Another "
            "motion or command moved it, or its motors could not follow."
        )


def _leave(robot: RobotView, keyboard: Keyboard) -> None:
    """Stop the robot where it is when a signal ends the node."""
    keyboard.close()  # first: a bridge that does not answer ends the program here
    try:
        if robot.motions.leave():
            notify("stopped; the robot stays where it is.")
    except G1DescriptionError as error:
        notify(f"the robot may go on: {error}")


def main() -> None:
    """Run the command, or exit with a message."""
    args = parse(PlayOptions, "play", own_arguments())
    try:
        play(args)
    except G1DescriptionError as error:
        sys.exit(f"play: {error}")
    except OSError as error:
        sys.exit(f"play: {error.strerror or error}")
