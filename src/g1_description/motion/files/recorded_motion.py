"""The motion in a recording of ROS: joints on a topic, and the base on TF."""

from __future__ import annotations

import posixpath
from collections.abc import Callable, Collection, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from g1_description.errors import MotionError, cause
from g1_description.motion.files.recorded_states import (
    Poses,
    Row,
    base_path,
    joined_states,
    joint_rows,
    nanoseconds,
    ordered_path,
    poses_at,
)
from g1_description.motion.files.recordings import (
    Channel,
    Recording,
    messages_of,
    topics_of,
)
from g1_description.motion.files.source import MotionSource
from g1_description.motion.motion import Motion
from g1_description.robot.description import Description
from g1_description.text import listed

USUAL = ("joint_states", "motion", "joint_trajectory", "joint_commands")
"""Usual names of topics with joints, by preference."""

JOINTS = ("JointState", "JointTrajectory", "RobotTrajectory")
"""Message types with joints."""


def reader(
    opened: Callable[[MotionSource], AbstractContextManager[Recording]],
) -> Callable[[MotionSource, Description], Motion]:
    """Make a format's function that reads a motion.

    Args:
        opened: Opens a file.
    """

    def read(source: MotionSource, robot: Description) -> Motion:
        """Read joints, and the base on TF or in an odometry."""
        with damage_told(), opened(source) as bag:
            return _motion(bag, robot, source.options.topic)

    return read


@contextmanager
def damage_told() -> Iterator[None]:
    """Raise a MotionError for each error of a damaged file."""
    try:
        yield
    except MotionError:
        raise
    except Exception as error:  # of a library or a decompressor
        raise MotionError(f"The bag cannot be read: {cause(error)}.") from error


def _motion(bag: Recording, robot: Description, topic: str | None) -> Motion:
    """Read the motion on a topic, or on the usual one."""
    topics = topics_of(bag, *JOINTS)
    name = _chosen(bag, topics, topic)
    joints = topics.pop(name)
    if joints[0].kind == "JointState":
        rows = joint_rows(bag, joints)
        states, notes = joined_states(name, rows, partial(base_path, bag, name, robot))
        notes += _publishers(joints, rows)
        motion = replace(states.motion(), notes=tuple(notes))
    else:
        motion = _trajectory(name, list(messages_of(bag, joints)))
    also = f" It also has joints on {listed(topics)}." if topics else ""
    return replace(motion, notes=(f"{motion.notes[0]}{also}", *motion.notes[1:]))


def _publishers(joints: Collection[Channel], rows: Sequence[Row]) -> list[str]:
    """Report several publishers of the same joints."""
    orders = {tuple(names) for _, _, names, *_ in rows}
    senders = {channel.sender for channel in joints}
    every = [name for names in orders for name in names]
    is_shared = len(orders) == 1 or len({*every}) < len(every)
    several = max(len(senders), len(orders)) if is_shared else 1
    if several == 1:
        return []
    known = listed(filter(None, sorted(map(str, senders - {None}))))
    return [
        f"Samples of {several} publishers{f', {known},' if known else ''} are joined "
        "by their stamps: the joints jump where these differ."
    ]


def _chosen(bag: Recording, topics: Collection[str], name: str | None) -> str:
    """Choose the topic with the joints."""
    known = (
        listed(topics)
        or listed(f"{c.topic} ({c.type.replace('/msg/', '/')})" for c in bag.channels)
        or "nothing"
    )
    if name is not None:
        for topic in topics:
            if topic.strip("/") == name.strip("/"):
                return topic
        raise MotionError(f"The bag has no joints on {name}. Its topics: {known}.")
    for usual in USUAL:
        found = [topic for topic in topics if posixpath.basename(topic) == usual]
        plain = [topic for topic in found if topic.strip("/") == usual] or found
        if len(plain) > 1:
            raise MotionError(
                f"The bag has several robots, {listed(plain)}. Choose one with --topic."
            )
        if plain:
            return plain[0]
    if len(topics) != 1:
        raise MotionError(
            f"The bag has no {listed(USUAL)}. Choose the topic of the joints with "
            f"--topic: {known}."
        )
    return next(iter(topics))


def _trajectory(topic: str, messages: Sequence[tuple[int, Any]]) -> Motion:
    """Read the first trajectory, or join all if each has one point."""
    parts = [
        (time, getattr(message, "joints", message), getattr(message, "base", None))
        for time, message in messages
    ]
    for _, joints, base in parts:
        _check_points(topic, joints, base)
    _, joints, base = parts[0]
    if not joints.points:
        raise MotionError(f"The first message on {topic} has no points of joints.")
    if len(parts) > 1 and len(joints.points) == 1:
        return _stream(topic, parts)
    more = f", the first of {len(parts)} messages" if len(parts) > 1 else ""
    rates = [point.velocities for point in joints.points]
    has_rates = bool(joints.names) and all(map(len, rates))
    shape = len(joints.points), len(joints.names)
    stamps = np.array([nanoseconds(point) for point in joints.points])
    motion = Motion(
        stamps / 1e9,
        tuple(joints.names),
        np.array([point.positions for point in joints.points]).reshape(shape),
        np.array(rates) if has_rates else None,
    )
    notes = [f"Motion from {topic}{more}."]
    if base and base.points:
        own, bases, base_notes = ordered_path(_path(base))
        poses = poses_at(own, bases, stamps)
        motion, notes = replace(motion, base_poses=poses), [*notes, *base_notes]
    return replace(motion, notes=tuple(notes))


def _path(base: Any) -> Poses:
    """Return the poses of a base's points."""
    times = [nanoseconds(point) for point in base.points]
    return [(time, time, p.poses[0].numbers) for time, p in zip(times, base.points)]


def _check_points(topic: str, joints: Any, base: Any) -> None:
    """Check how many numbers the points of a trajectory have."""
    for number, point in enumerate(joints.points, 1):
        for values in (point.positions, point.velocities):
            is_left_out = values is point.velocities and not len(values)
            if len(values) != len(joints.names) and not is_left_out:
                raise MotionError(
                    f"Point {number} on {topic} must have {len(joints.names)} numbers "
                    f"(got {len(values)})."
                )
    for number, point in enumerate(base.points if base else (), 1):
        if len(point.poses) != 1:
            raise MotionError(
                f"Point {number} on {topic} must have one pose of the base (got "
                f"{len(point.poses)})."
            )


def _stream(topic: str, parts: Sequence[tuple[int, Any, Any]]) -> Motion:
    """Join the single points of a stream of trajectories."""
    rows, path = [], []
    for number, (time, joints, base) in enumerate(parts, 1):
        if len(joints.points) != 1 or (base and len(base.points) > 1):
            raise MotionError(
                f"Message {number} on {topic} must have exactly one point, like the "
                "first."
            )
        point = joints.points[0]
        numbers = point.positions, point.velocities, point.efforts
        rows.append((0, time, joints.names, *numbers))
        path += [(time, time, pose) for *_, pose in (_path(base) if base else ())]
    states, notes = joined_states(topic, rows, lambda _: (topic, path))
    return replace(states.motion(), notes=tuple(notes))
