"""Reading the history of a robot from a rosbag, such as that of an ended bridge."""

from __future__ import annotations

import posixpath
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from g1_description.errors import MotionError
from g1_description.motion.files import bag as rosbag
from g1_description.motion.files.recorded_motion import damage_told
from g1_description.motion.files.recorded_states import (
    base_path,
    joined_states,
    joint_rows,
    nanoseconds,
    ordered,
)
from g1_description.motion.files.recordings import Recording, messages_of, topics_of
from g1_description.motion.files.source import MotionSource
from g1_description.motion.history import CommandStream
from g1_description.motion.history_chunks import Command, Stretch
from g1_description.robot.description import Description
from g1_description.text import listed

if TYPE_CHECKING:
    from rosbags.rosbag1 import Reader

JOINTS = "joint_states"
"""Topic with the measured joints, in any namespace."""

COMMANDED_JOINTS = "commanded_joint_states"
"""Topic with the commanded joints, in the same namespace."""

COMMANDED_BASE = "commanded_base_pose"
"""Topic with the commanded poses of the base, in the same namespace."""

RECEIVED = "received_commands"
"""Topic with the commands that a bridge received, in the same namespace."""


def read_history(
    path: Path, robot: Description, seconds: float = 60.0
) -> tuple[Stretch, list[CommandStream]]:
    """Read the last states of a robot from a rosbag, and the commands meanwhile.

    Where time goes back in it, they are those of the last run. The base is that on TF
    or in an odometry, at the stamps of the joint states. Commanded positions and poses
    are the last ones that are not later than a state.

    Args:
        path: The bag, of a bridge that has ended or recorded with joint_states and TF.
        robot: The robot.
        seconds: How much of it is read, in [s].

    Returns:
        The states, in which is None what the bag does not have, and the commands with
        their positions, by their first.

    Raises:
        MotionError: If the file cannot be read, or has no joint states.
    """
    source = MotionSource(path)
    try:
        if not rosbag.recognise(source):
            raise MotionError("It is not a rosbag of ROS 1.")
        old_chunks = partial(_old_chunks, seconds=seconds)
        with damage_told(), rosbag.reader_of(path, old_chunks) as file:
            bag = rosbag.recording_of(file)
            topic = _joint_topic(bag)
            states = _states(bag, robot, topic)
            states = states.rows(states.stamps >= states.stamps[-1] - 1e9 * seconds)
            namespace = posixpath.dirname(topic)
            states = _commanded(bag, states, namespace)
            return states, _received(bag, namespace, int(states.stamps[0]))
    except MotionError as error:
        raise MotionError(f"{path.name}: {error}") from error


def _old_chunks(bag: Reader, seconds: float) -> set[int]:
    """Find the chunks of a bag before its last states, with nothing that lasts."""
    joints, lasting = (
        {c.id for c in bag.connections if posixpath.basename(c.topic) in names}
        for names in ((JOINTS,), (RECEIVED, "tf_static"))
    )
    own = [one for one in bag.chunk_infos if joints & one.connection_counts.keys()]
    if not own:
        return set()
    begin = max(own, key=lambda one: one.pos).end_time - 1e9 * seconds
    old = (one for one in bag.chunk_infos if one.end_time < begin)
    return {one.pos for one in old if not lasting & one.connection_counts.keys()}


def _joint_topic(bag: Recording) -> str:
    """Find the topic joint_states."""
    topics = topics_of(bag, "JointState")
    found = [topic for topic in topics if posixpath.basename(topic) == JOINTS]
    plain = [topic for topic in found if topic == f"/{JOINTS}"] or found
    if len(plain) == 1:
        return plain[0]
    if plain:
        raise MotionError(
            f"The bag has several robots, {listed(found)}. Reduce it to one with "
            "'rosbag filter'."
        )
    known = listed(channel.topic for channel in bag.channels) or "nothing"
    raise MotionError(f"The bag has no {JOINTS}. Its topics: {known}.")


def _states(bag: Recording, robot: Description, topic: str) -> Stretch:
    """Read what is measured."""
    rows = joint_rows(bag, topics_of(bag, "JointState")[topic])
    find_base = partial(base_path, bag, topic, robot)
    return joined_states(topic, rows, find_base, is_last=True)[0]


def _commanded(bag: Recording, states: Stretch, namespace: str) -> Stretch:
    """Add what is commanded to states."""
    topic = posixpath.join(namespace, COMMANDED_JOINTS)
    stamps, messages = _last_run(bag, "JointState", topic)
    if messages:
        alike: dict[tuple[str, ...], list[int]] = {}
        for row, message in enumerate(messages):
            alike.setdefault(tuple(message.names), []).append(row)
        names = tuple(dict.fromkeys(name for own in alike for name in own))
        found = np.full((len(messages), len(names)), np.nan)
        for own, rows in alike.items():
            columns = [names.index(name) for name in own]
            found[np.ix_(rows, columns)] = [messages[row].positions for row in rows]
        held = _held(stamps, found, states.stamps)
        states = replace(states, commanded_names=names, commanded=held)
    topic = posixpath.join(namespace, COMMANDED_BASE)
    stamps, messages = _last_run(bag, "PoseStamped", topic)
    if messages:
        poses = np.array([message.pose for message in messages])
        states = replace(states, commanded_bases=_held(stamps, poses, states.stamps))
    return states


def _received(bag: Recording, namespace: str, begin: int) -> list[CommandStream]:
    """Read the received commands from a time in [ns] on."""
    found, topic = [], posixpath.join(namespace, RECEIVED)
    channels = topics_of(bag, "ReceivedCommands").get(topic, [])
    for _, message in messages_of(bag, channels):
        first, last = nanoseconds(message.first), nanoseconds(message.last)
        if last >= begin:
            found.append(_since(begin, stream_from(message, first, last)))
    return sorted(found, key=lambda stream: stream.first)


def stream_from(message: Any, first: int, last: int) -> CommandStream:
    """Read commands from a ReceivedCommands, with its stamps in [ns]."""
    m = message
    command = Command(m.sender, m.topic, m.content, tuple(m.joint_names))
    stream = CommandStream(first, last, m.count, command)
    if len(m.times):
        stream.stamps = first + np.round(1e9 * np.array(m.times)).astype(np.int64)
        stream.positions = np.reshape(m.positions, (m.count, len(m.joint_names)))
    return stream


def _since(begin: int, stream: CommandStream) -> CommandStream:
    """Return the commands of a stream from a time in [ns] on."""
    if stream.stamps is None or stream.positions is None:
        return stream
    kept = stream.stamps >= min(begin, int(stream.stamps[-1]))
    stamps, positions = stream.stamps[kept], stream.positions[kept]
    first, last = int(stamps[0]), int(stamps[-1])
    return CommandStream(first, last, len(stamps), stream.command, stamps, positions)


def _last_run(bag: Recording, kind: str, topic: str) -> tuple[np.ndarray, list[Any]]:
    """Return stamps in [ns], shape (n,), and the messages of a topic's last run."""
    channels = topics_of(bag, kind).get(topic, [])
    messages = [message for _, message in messages_of(bag, channels)]
    stamps = np.array([nanoseconds(message) for message in messages], np.int64)
    if not messages:
        return stamps, messages
    order, _ = ordered(stamps, topic, is_last=True)
    return stamps[order], [messages[row] for row in order]


def _held(stamps: np.ndarray, values: np.ndarray, at: np.ndarray) -> np.ndarray:
    """Return the last values until each of some times, NaN before the first ones."""
    rows = np.searchsorted(stamps, at, "right") - 1
    return np.where(rows[:, np.newaxis] < 0, np.nan, values[rows])
