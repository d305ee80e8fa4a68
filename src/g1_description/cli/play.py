"""The command play, which plays a motion from a file on a running robot."""

from __future__ import annotations

import contextlib
import os
import re
import select
import sys
import termios
import tty
from contextlib import closing

import numpy as np
import rospy

from g1_description.cli.play_options import PlayOptions
from g1_description.command_line import exit_with_error, say
from g1_description.errors import (
    G1DescriptionError,
    InvalidValueError,
    MotionError,
)
from g1_description.motion.edit import moved, to_start_at
from g1_description.motion.files.formats import read_motion
from g1_description.motion.files.source import ReadOptions
from g1_description.motion.motion import Motion, sample
from g1_description.motion.paths import absent, split
from g1_description.robot.transform import IDENTITY, compose, inverse
from g1_description.ros.carrying import Carrying
from g1_description.ros.lifecycle import start_node
from g1_description.ros.map_frame import MapFrame
from g1_description.ros.playing import Session
from g1_description.ros.robot_view import RobotView
from g1_description.ros.waiting import NoAnswerError, RefusedError, wait_until
from g1_description.scenes.scene import Scene
from g1_description.scenes.scene_file import scene_next_to
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
"""Names of the supported keys, by the bytes that a terminal sends."""

END = "q"
"""The key that is returned when the terminal is gone."""

ONE_KEY = re.compile(rb"\x1b(?:\[[0-?]*[ -/]*[@-~]|O[@-~])|[^\x1b]", re.DOTALL)
"""The bytes that a terminal sends for one key."""

PART_OF_KEY = re.compile(rb"\x1b(?:\[[0-?]*[ -/]*|O)?\Z")
"""An incomplete key, or Escape."""


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
            Its name in ``KEYS``, ``END`` if the terminal is gone; empty if no supported
            key was pressed.
        """
        name = self._take()
        if name:
            return name
        descriptors = [] if self._descriptor is None else [self._descriptor]
        if not select.select(descriptors, [], [], timeout)[0]:
            self._pending = b""  # incomplete: the rest would have arrived by now
            return ""
        try:
            sent = os.read(descriptors[0], 1024)
        except OSError:  # the terminal is gone
            sent = b""
        self._pending += sent
        return self._take() if sent else END

    def _take(self) -> str:
        """Remove the first supported key from the bytes; return its name or nothing."""
        while self._pending and not PART_OF_KEY.match(self._pending):
            key = ONE_KEY.match(self._pending)
            length = key.end() if key else 1
            taken, self._pending = self._pending[:length], self._pending[length:]
            if taken in KEYS:
                return KEYS[taken]
        return ""

    def close(self) -> None:
        """Restore the terminal; from any thread, any number of times."""
        # In the background, this call would stop the program.
        if self._descriptor is not None and not _is_in_background(self._descriptor):
            with contextlib.suppress(termios.error):  # it may be gone
                # TCSANOW: after Ctrl-S, waiting for the output would hang.
                termios.tcsetattr(self._descriptor, termios.TCSANOW, self._before)


def terminal() -> int | None:
    """Return the terminal that this program may read keys from; None without one."""
    if not sys.stdin.isatty():
        return None
    descriptor = sys.stdin.fileno()
    return None if _is_in_background(descriptor) else descriptor


def _is_in_background(descriptor: int) -> bool:
    """Return whether a terminal has another program in its foreground."""
    try:
        return os.getpgrp() != os.tcgetpgrp(descriptor)
    except OSError:  # it is not the controlling terminal, or is gone
        return False


TIMEOUT = 30.0
"""Longest wait for the bridge, in [s]: machines may be busy."""

BASE_TIMEOUT = 2.0
"""Longest wait for the robot's base, in [s]."""

REFRESH_PERIOD = 0.05
"""Period of updates of the progress, in [s]."""

CARRYING_PERIOD = 0.005
"""Largest delay with which objects are attached and let go, in [s]."""

TOLERANCE = 0.1
"""Largest distance of a joint from the end of its motion, in [rad] or [m]: motors have
errors."""

END_TIME = 1_000_000_000
"""Time in which motors must reach the end of a motion, in [ns]."""

BAR = 24
"""Length of the progress bar, in characters."""


def notify(text: str) -> None:
    """Print a message in a separate line."""
    begin = "\r\x1b[K" if sys.stdout.isatty() else ""
    say(f"{begin}play: {text}")


def prepare(args: PlayOptions, robot: RobotView) -> tuple[Motion, Motion]:
    """Read the motion, and move it as requested.

    Returns:
        The motion as it is in the file, and as it is played.

    Raises:
        MotionError: If the file cannot be read, or its motion does not fit the robot.
        InvalidValueError: If it does not contain the requested part, or has no base.
        NoAnswerError: If there is no master.
    """
    options = ReadOptions(args.fps, args.topic, args.order, args.format)
    motion = read_motion(args.file, robot.description, options)
    for note in motion.notes:
        notify(note)
    whole, motion = motion, motion.cut(args.begin, args.end)
    requested = [args.start_here and "--start-here", args.on_floor and "--on-floor"]
    if motion.base_poses is None and any(requested):
        names = " and ".join(filter(None, requested))
        raise InvalidValueError(
            f"{names} needs a motion with a base, which {args.file.name} lacks."
        )
    if motion.base_poses is not None and args.anchor is not None:
        raise InvalidValueError(
            f"--anchor needs a motion without a base, but {args.file.name} has one."
        )
    if args.start_here:
        motion = to_start_at(motion, base_pose(robot, args.base_frame))
    if args.on_floor:
        lowest = lowest_height(robot.description, motion)
        T_map_motion = IDENTITY.copy()
        T_map_motion[2] = -lowest
        motion = moved(motion, T_map_motion)
        notify(f"moved the motion by {-lowest:+.4f} m in height.")
    return whole, motion


def base_pose(robot: RobotView, frame: str | None) -> np.ndarray:
    """Return the pose of the robot's base in the map, shape (7,).

    Args:
        robot: The robot.
        frame: TF frame of the base; None: use the robot's state.

    Raises:
        MotionError: If it is unknown.
    """
    if frame:
        return MapFrame().pose_in_map(IDENTITY, frame, rospy.Time())

    def has_base() -> bool:
        return robot.state is not None and robot.state.base_pose is not None

    if not wait_until(has_base, BASE_TIMEOUT):
        raise MotionError(f"{robot.no_base}; set its TF frame with --base-frame.")
    return robot.state.base_pose


def progress(session: Session, speed: float) -> str:
    """Return a progress bar."""
    begin, end, time = session.begin, session.end, session.time
    share = (time - begin) / (end - begin) if end > begin else 1.0
    done = round(share * BAR)
    bar = "#" * done + "." * (BAR - done)
    samples = f"sample {session.sample} of {len(session.motion.times)}"
    state = "" if session.is_running else "  paused"
    rate = "" if speed == 1.0 else f"  x {speed:g}"
    return f"[{bar}] {time:6.2f} of {end:.2f} s  {samples}{rate}{state}"


def carrying(
    args: PlayOptions, robot: RobotView, whole: Motion, motion: Motion
) -> Carrying | None:
    """Read the scene of the options or next to the motion; None without attachments.

    Args:
        args: The options.
        robot: The robot.
        whole: The motion as it is in the file.
        motion: The motion as it is played.

    Raises:
        SceneError: If it cannot be used.
        UnknownNameError: If the robot lacks a link that carries something.
    """
    file = args.scene or scene_next_to(split(args.file)[0])
    if file is None:
        return None
    state, name = robot.state, args.namespace.strip("/").rpartition("/")[2]
    base = None if state is None else state.base_pose
    base = IDENTITY if base is None else base
    shift = IDENTITY
    if motion.base_poses is not None:
        start = sample(whole, motion.times[:1]).base_poses
        assert start is not None
        shift = compose(motion.base_poses[0], inverse(start[0]))
    given = Scene.read(file), robot.description, whole, name, notify, base, shift
    return Carrying(*given) or None


def follow(
    session: Session, keyboard: Keyboard, args: PlayOptions, carried: Carrying | None
) -> None:
    """Play until the end, or until the user stops it.

    Raises:
        NoAnswerError: If the robot is reset, or the bridge does not answer.
        ROSInterruptException: If a signal ends it.
    """
    shows = sys.stdout.isatty()
    _check_signals()
    session.start()
    while True:
        key = keyboard.next_key(CARRYING_PERIOD if carried else REFRESH_PERIOD)
        _check_signals()
        if carried and session.has_begun:
            carried.show(session.time)
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
    if not split(args.file)[0].exists():
        raise InvalidValueError(absent(args.file))
    start_node("play", anonymous=True, disable_rosout=True)
    robot = RobotView(args.namespace, notify)
    if not robot.wait_until(lambda: robot.state, TIMEOUT):
        raise NoAnswerError(f"The robot's state is unknown: {robot.silence}")
    whole, motion = prepare(args, robot)
    carried = carrying(args, robot, whole, motion)
    session = Session(robot, motion, args.speed, notify, args.lead_in)
    with closing(Keyboard(terminal())) as keyboard:
        # Before the shutdown, while services can be called: else the robot continues.
        rospy.core.add_preshutdown_hook(lambda _: _leave(robot, keyboard))
        with robot.anchored(args.anchor):
            follow(session, keyboard, args, carried)
    if session.is_over:
        _check_end(robot, motion, args.file.name)
        notify(f"{args.file}: {session.end - session.begin:.2f} s played.")


def _check_end(robot: RobotView, motion: Motion, name: str) -> None:
    """Check that the robot reached the end of the motion.

    Raises:
        NoAnswerError: If it does not.
    """
    last = dict(zip(motion.joint_names, motion.positions[-1].tolist()))
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
            f"{name} has ended, but the robot is not at its last sample: "
            f"{listed(away)}. Another command moved it, or its motors could not follow."
        )


def _leave(robot: RobotView, keyboard: Keyboard) -> None:
    """Stop the robot when a signal ends the node."""
    keyboard.close()  # first, as the call below may time out
    try:
        if robot.motions.leave():
            notify("stopped; the robot keeps its position.")
        robot.restore_anchor()
    except G1DescriptionError as error:
        notify(f"the robot may keep moving: {error}")


def main(args: PlayOptions) -> None:
    """Run the command, or exit with a message."""
    try:
        play(args)
    except (NoAnswerError, RefusedError) as error:
        sys.exit(f"play: {error}")
    except G1DescriptionError as error:
        exit_with_error("play", error)
    except OSError as error:
        sys.exit(f"play: {error.strerror or error}")
