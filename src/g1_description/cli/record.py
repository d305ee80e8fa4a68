"""The command record, which records the motion of a running robot."""

from __future__ import annotations

import argparse
import math
import posixpath
import signal
import sys
import time
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Union

import rosgraph
import rospy

from g1_description.bridge.recorded_file import ENDINGS, room_of, write_motion_file
from g1_description.choices import GAZEBO
from g1_description.cli.options import namespace
from g1_description.cli.recorder import BridgeStates, Recorder, SimulatorStates
from g1_description.cli.start import time_entered
from g1_description.command_line import (
    MAX_FPS,
    argument,
    exit_with_error,
    option,
    own_arguments,
    parse,
    positive,
    say,
    within,
)
from g1_description.errors import G1DescriptionError, InvalidValueError
from g1_description.motion.files.conventions import known_velocities
from g1_description.robot.description import Description
from g1_description.ros.history import fetch_history
from g1_description.ros.lifecycle import handle_signals, start_node
from g1_description.ros.present_objects import RecordedObjects
from g1_description.ros.robot_view import wait_for_description
from g1_description.ros.waiting import NoAnswerError, RefusedError, wait_until
from g1_description.scenes.scene_file import scene_of

TIMEOUT = 20.0
"""Longest wait for the first state, in [s]: machines may be busy."""

SPAWN_TIMEOUT = 5.0
"""Longest wait for a robot that is missing in the simulator, in [s]."""

GONE = 5.0
"""Time without a simulator after which the recording ends, in [s]: it may be
respawned."""

QUIET = 2.0
"""Time without states after which a message is printed, in [s]."""

POLL_PERIOD = 0.05
"""Polling period, in [s]."""


def _ros_name(text: str) -> str:
    """Read a name of ROS, which may begin with a slash."""
    if rosgraph.names.is_legal_name(text):
        return text
    raise argparse.ArgumentTypeError(f"'{text}' is not a valid ROS name")


@dataclass(frozen=True)
class RecordOptions:
    """Record base and joints of a running robot.

    Ctrl-C ends and saves the recording.
    """

    out: Path = argument(f"output file: {', '.join(ENDINGS)}", Path, metavar="OUT")
    rate: float = option(
        "samples per second of simulated time; 0: every state", 50.0, within(0, MAX_FPS)
    )
    seconds: float | None = option(
        "duration in simulated time [s]", None, positive(math.inf), shown="until Ctrl-C"
    )
    last: float | None = option(
        "save the last seconds, of those that the bridge keeps [s]",
        None,
        positive(math.inf),
        shown="record from now on",
    )
    namespace: str = namespace()
    model: str = option(
        "name of the robot in the simulator", "", shown="the one with its links"
    )
    gazebo: str = option("namespace of the simulator", "/gazebo", _ros_name)
    force: bool = option("replace an existing file", False)


def _check_place(out: Path, force: bool) -> None:
    """Check that a file can be written, before anything is recorded."""
    if out.suffix.lower() not in ENDINGS:
        raise InvalidValueError(
            f"Unknown format of {out}: it must end in {' or '.join(ENDINGS)}."
        )
    if scene_of(out).exists() and not out.exists():
        out = scene_of(out)
    if out.is_dir() or (out.exists() and not force):
        kind = "folder" if out.is_dir() else "file"
        hint = "" if out.is_dir() else "; use --force to replace it"
        raise InvalidValueError(f"The {kind} {out} already exists{hint}.")
    trial = out.with_name(f".{out.name}.trial")
    try:
        trial.touch()
        trial.unlink(missing_ok=True)
    except OSError as error:
        raise InvalidValueError(
            f"The file {out} cannot be written: {error.strerror}."
        ) from error


def notify(text: str) -> None:
    """Print a message."""
    say(f"record: {text}", sys.stderr)


def record(args: RecordOptions) -> None:
    """Record and save.

    Raises:
        G1DescriptionError: If no state arrives, there is no bridge that has kept the
            last ones, or the file cannot be written.
    """
    start_node("record", anonymous=True, disable_rosout=True)
    robot = wait_for_description(args.namespace, notify)
    recorder = Recorder(args.rate, args.seconds, partial(room_of, args.out))
    if args.last is not None:
        stretch, note = fetch_history(args.last, args.namespace, time_entered())
        for state in stretch.states():
            recorder.take(state)
        if recorder.refusal:
            raise recorder.refusal
        if note:
            notify(note)
        save(recorder, robot, args)
        return
    states = states_of(robot, recorder, args)
    model = args.model or args.namespace.strip("/").rpartition("/")[2]
    objects = RecordedObjects(args.gazebo, robot, model, notify)
    _wait_for_first(recorder, states)
    objects.begin()
    stop = _Stop()
    seconds = "" if args.seconds is None else f" {args.seconds:g} s, or"
    notify(f"recording{seconds} until Ctrl-C.")
    _follow(recorder, states, stop)
    recorder.is_over = True
    states.close()
    save(recorder, robot, args, objects)


States = Union[BridgeStates, SimulatorStates]


def states_of(robot: Description, recorder: Recorder, args: RecordOptions) -> States:
    """Subscribe to the bridge of a robot, or to a simulator if there is no bridge.

    A given model or simulator may not be that of the bridge.
    """
    topic = rospy.resolve_name(posixpath.join(f"/{args.namespace}", "robot_state"))
    if not args.model and args.gazebo == GAZEBO:
        published = {name for name, _ in rospy.get_published_topics()}
        if args.namespace or topic in published:
            return BridgeStates(topic, recorder)
    simulator = (args.gazebo, args.model, args.namespace)
    return SimulatorStates(robot, *simulator, recorder)


class _Stop:
    """A stop request by a signal, after which the recording is saved."""

    def __init__(self) -> None:
        self.is_requested = False
        signal.set_wakeup_fd(-1)
        handle_signals(self._take)

    def _take(self, *_: object) -> None:
        """Record a signal, without locks; the next SIGINT interrupts."""
        self.is_requested = True
        signal.signal(signal.SIGINT, signal.default_int_handler)


def _wait_for_first(recorder: Recorder, states: States) -> None:
    """Wait for the first sample.

    Raises:
        NoAnswerError: If none arrives.
        UnknownNameError: If the simulator lacks the robot.
        MotionError: If the format does not support the motion.
    """
    missed = math.inf

    def is_known() -> bool:
        nonlocal missed
        states.keep_up()
        missed = min(missed, time.monotonic()) if states.problem else math.inf
        is_late = time.monotonic() > missed + SPAWN_TIMEOUT
        return bool(recorder.refusal or recorder.states or is_late)

    wait_until(is_known, TIMEOUT, period=POLL_PERIOD)
    if recorder.refusal:
        raise recorder.refusal
    if not recorder.states:
        raise states.problem or NoAnswerError(
            f"There was no state of the robot on {states.topic} within {TIMEOUT:g} s; "
            "is a simulator running and unpaused? To record a robot without a "
            "simulator, use 'rosbag record /joint_states /tf'."
        )


def _follow(recorder: Recorder, states: States, stop: _Stop) -> None:
    """Wait for the end of the recording."""
    was_reported = False
    connected = time.monotonic()

    def is_over() -> bool:
        nonlocal was_reported, connected
        states.keep_up()
        if states.is_connected:
            connected = time.monotonic()
        elif time.monotonic() > connected + GONE:
            recorder.end("the simulator ended")
        is_quiet = time.monotonic() - recorder.heard > QUIET
        if is_quiet and not was_reported:
            notify(f"no messages on {states.topic}; is time paused?")
        was_reported = is_quiet
        return recorder.is_over or stop.is_requested

    with suppress(rospy.ROSInterruptException):  # the recording is saved
        wait_until(is_over, period=POLL_PERIOD)


def save(
    recorder: Recorder,
    robot: Description,
    args: RecordOptions,
    objects: RecordedObjects | None = None,
) -> None:
    """Save the recording, and the objects around the robot if there were any.

    Raises:
        G1DescriptionError: If it cannot be written.
    """
    motion, begin = recorder.motion()
    # Of streamed configurations they are all zero.
    motion = replace(motion, velocities=known_velocities(motion))
    rate = args.rate or None
    notes = write_motion_file(args.out, motion, robot, rate, begin)
    for note in (*recorder.notes, *notes):
        notify(note)
    count = len(motion.times)
    text = f"{args.out}: {count} samples, {motion.duration:.2f} s"
    print(f"{text}, begins at {1e-9 * begin:.3f} s", flush=True)
    start = 1e-9 * begin
    scene = objects and objects.scene(start, start + motion.duration)
    if scene:
        file = scene_of(args.out)
        scene.save(file)
        print(f"{file}: {len(scene)} objects", flush=True)


def main() -> None:
    """Run the command, or exit with a message."""
    try:
        options = parse(RecordOptions, "record", own_arguments())
        _check_place(options.out, options.force)
        if options.last is not None and (
            options.seconds or options.model or options.gazebo != GAZEBO
        ):
            raise InvalidValueError(
                "--last saves what the bridge has kept: it cannot be combined with "
                "--seconds, --model or --gazebo."
            )
        record(options)
    except (NoAnswerError, RefusedError) as error:
        sys.exit(f"record: {error}")
    except G1DescriptionError as error:
        exit_with_error("record", error)
    except (OSError, rosgraph.MasterException) as error:
        sys.exit(f"record: Lost the connection to the master: {error}.")
