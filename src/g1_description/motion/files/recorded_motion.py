"""The motion in a recording of ROS: joints on a topic, and the base on TF."""

from __future__ import annotations

import posixpath
from collections.abc import Callable, Collection, Sequence
from contextlib import AbstractContextManager
from dataclasses import replace
from typing import Any, List, Tuple

import numpy as np

from g1_description.errors import MotionError, cause
from g1_description.motion.files.arrays import MAX_SIZE
from g1_description.motion.files.recordings import (
    Channel,
    Recording,
    messages_of,
    topics_of,
)
from g1_description.motion.files.source import MotionSource
from g1_description.motion.motion import Motion, sample
from g1_description.robot.assembly import BASE_FRAME, MAP, base_of
from g1_description.robot.description import Description
from g1_description.robot.transform import IDENTITY, compose
from g1_description.text import listed

PARENTS = (MAP, "world", "odom")
"""Parent frames of a base, by preference."""

USUAL = ("joint_states", "motion", "joint_trajectory", "joint_commands")
"""Usual names of topics with joints, by preference."""

MAX_LATE = 1_000_000_000
"""Distance from the stamps around it at which a stamp is wrong, in [ns]."""

MANY = 10
"""Samples in a row that are behind where time restarts."""

FEW = 3
"""Samples in a row that may have wrong stamps."""

LATE = 100_000_000
"""Time without a base that is reported, in [ns]: the bridge publishes it every 0.05
s."""

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
        try:
            with opened(source) as bag:
                return _motion(bag, robot, source.options.topic)
        except MotionError:
            raise
        # Any error of a library or a decompressor on a damaged file.
        except Exception as error:
            raise MotionError(f"The bag cannot be read: {cause(error)}.") from error

    return read


def _nanoseconds(stamp: Any) -> int:
    """Convert a stamp or a duration to [ns]."""
    return stamp.secs * 1_000_000_000 + stamp.nsecs


def _motion(bag: Recording, robot: Description, topic: str | None) -> Motion:
    """Read the motion on a topic, or on the usual one."""
    topics = topics_of(bag, *JOINTS)
    name = _chosen(bag, topics, topic)
    joints = topics.pop(name)
    messages = messages_of(bag, joints)
    if joints[0].kind == "JointState":
        rows: list[_Row] = []
        for time, state in messages:
            # Most messages have equal names, which are kept once.
            names = rows[-1][2] if rows and rows[-1][2] == state.names else state.names
            stamp = _nanoseconds(state)
            rows.append((stamp, time, names, state.positions, state.velocities))
        motion = _joined(name, rows, lambda has: _base(bag, name, robot, has))
        motion = replace(motion, notes=(*motion.notes, *_publishers(joints, rows)))
    else:
        motion = _trajectory(name, list(messages))
    also = f" It also has joints on {listed(topics)}." if topics else ""
    return replace(motion, notes=(f"{motion.notes[0]}{also}", *motion.notes[1:]))


def _publishers(joints: Collection[Channel], rows: Sequence[_Row]) -> list[str]:
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


_Row = Tuple[int, int, List[str], np.ndarray, np.ndarray]
"""A sample: stamp and time of recording in [ns], names, positions, velocities."""

_Poses = List[Tuple[int, int, np.ndarray]]
"""Stamps and times of recording in [ns], and poses, shape (7,)."""

_Path = Tuple[str, _Poses]
"""A path of the base: its source, and its poses."""


def _joined(
    topic: str, rows: Sequence[_Row], find_base: Callable[[bool], _Path]
) -> Motion:
    """Join samples and the base, by stamps or times of recording."""
    stamps, times = np.array([row[:2] for row in rows]).T
    notes: list[str] = []
    has_stamps = bool(stamps.all())
    if not has_stamps:
        stamps = times
        notes.append("Some messages have no stamps: the times of recording are used.")
    kept, order_notes = _ordered(stamps, "samples")
    notes += order_notes
    names, positions, velocities = _table(topic, [rows[number] for number in kept])
    stamps = stamps[kept]
    source, path = find_base(has_stamps)
    poses = None
    if path:
        own, bases, base_notes = _ordered_path(path)
        notes += base_notes
        if own[0] > stamps[0] + LATE:
            seconds = (own[0] - stamps[0]) / 1e9
            notes.append(
                f"There is no base pose before {seconds:.3f} s: the first one is held."
            )
        poses = _poses_at(own, bases, stamps)
    is_last = np.append(np.diff(stamps) > 0, True)
    motion = Motion(
        (stamps[is_last] - stamps[0]) / 1e9,
        names,
        positions[is_last],
        None if velocities is None else velocities[is_last],
        None if poses is None else poses[is_last],
    )
    whence = f", base from {source}" if path else ""
    return replace(motion, notes=(f"Joints from {topic}{whence}.", *notes))


def _table(
    topic: str, rows: Sequence[_Row]
) -> tuple[tuple[str, ...], np.ndarray, np.ndarray | None]:
    """Put the joints of all samples into columns.

    Returns:
        Names; positions, where missing values are the previous ones, or else the next
        ones; velocities, None unless all samples have those of all joints.
    """
    columns: dict[str, int] = {}
    for number, (*_, names, given, _) in enumerate(rows, 1):
        if len(given) != len(names):
            raise MotionError(
                f"Message {number} on {topic} has {len(given)} positions of "
                f"{len(names)} joints."
            )
        for name in names:
            columns.setdefault(name, len(columns))
    if len(columns) * len(rows) > MAX_SIZE:
        raise MotionError(f"{topic} has more than {MAX_SIZE} numbers.")
    positions, velocities = np.full((2, len(rows), len(columns)), np.nan)
    for row, (*_, names, given, rates) in enumerate(rows):
        which = [columns[name] for name in names]
        positions[row, which] = given
        if len(rates) == len(which):
            velocities[row, which] = rates
    for turned in (positions, positions[::-1]):
        known = np.isfinite(turned)
        if not known.all():
            last = np.where(known, np.arange(len(turned))[:, np.newaxis], 0)
            np.maximum.accumulate(last, axis=0, out=last)
            turned[:] = turned[last, np.arange(turned.shape[1])]
    is_whole = np.isfinite(velocities).all()
    return tuple(columns), positions, velocities if is_whole else None


def _ordered(stamps: np.ndarray, label: str) -> tuple[np.ndarray, list[str]]:
    """Put samples in the order of their stamps, until time restarts.

    Stamps fall where messages are late, or of several publishers. Time restarts where
    one is before the ``MANY`` before it, and the ``MANY`` from it on are behind. Up to
    ``FEW`` in a row that are far from those around them are ignored.

    Args:
        stamps: In [ns], shape (n,).
        label: Name of the samples, for messages.

    Returns:
        Indices of the samples in order, and messages on ignored ones.
    """
    count = len(stamps)
    near = np.arange(count)[:, np.newaxis] + np.arange(-FEW, FEW + 1)
    if count > 2 * FEW:  # the first and the last one do not outweigh their neighbours
        near[0], near[-1] = near[FEW], near[-FEW - 1]
    usual = np.median(stamps[np.clip(near, 0, count - 1)], axis=1)
    far = MAX_LATE + FEW * np.median(np.abs(np.diff(stamps, prepend=stamps[0])))
    kept = np.flatnonzero(np.abs(stamps - usual) <= far)
    times = stamps[kept]
    newest = np.maximum.accumulate(times)
    end = len(times)
    for row in np.flatnonzero(np.diff(times) < 0) + 1:
        is_first = times[row] < times[max(row - MANY, 0) : row].min()
        following, behind = times[row : row + MANY], newest[row - 1] - times[row]
        is_long = len(following) == MANY or behind > far
        if is_first and is_long and following.max() < newest[row - 1]:
            end = int(row)
            break
    n_late = int((times[:end] < newest[:end]).sum())
    order = kept[:end][np.argsort(times[:end], kind="stable")]
    notes = []
    if n_late:
        clocks = ", as of publishers whose clocks differ" if n_late > MANY else ""
        notes.append(f"Late {label} are sorted by stamps: {n_late} of {count}{clocks}.")
    if len(kept) < count:
        notes.append(
            f"Stamps more than {MAX_LATE / 1e9:g} s from those around them are "
            f"ignored: {count - len(kept)} of {count} {label}."
        )
    if end < len(times):
        passed = (newest[end - 1] - times[:end].min()) / 1e9
        notes.append(
            f"Time goes back after {passed:.3f} s; the last {len(times) - end} of "
            f"{count} {label} ({np.ptp(times[end:]) / 1e9:.3f} s) are ignored."
        )
    return order, notes


def _ordered_path(path: _Poses) -> tuple[np.ndarray, np.ndarray, list[str]]:
    """Return stamps in [ns], increasing, poses, and messages on ignored ones."""
    stamps = np.array([step[0] for step in path])
    order, notes = _ordered(stamps, "base poses")
    order = order[np.append(np.diff(stamps[order]) > 0, True)]
    return stamps[order], np.array([path[number][2] for number in order]), notes


def _poses_at(
    own: np.ndarray, poses: np.ndarray, stamps: np.ndarray
) -> np.ndarray | None:
    """Interpolate poses at their own stamps; the first and last ones are held."""
    times = (own - own[0]) / 1e9
    base = Motion(times, (), np.empty((len(times), 0)), None, poses)
    return sample(base, (stamps - own[0]) / 1e9).base_poses


def _base(bag: Recording, joints: str, robot: Description, has_stamps: bool) -> _Path:
    """Find the path of the base: on TF, else in an odometry.

    Args:
        bag: The bag.
        joints: The topic with the joints, in whose namespace the base is.
        robot: The robot.
        has_stamps: Whether the stamps of messages count, not when they were recorded.

    Returns:
        The path, empty if there is none.
    """
    namespace = posixpath.dirname(joints).strip("/")
    root, _ = base_of(robot)
    own = {*robot.link_names, BASE_FRAME} - {*PARENTS}
    prefixes = (f"{namespace}/", "") if namespace else ("",)
    frames = [prefix + f for prefix in prefixes for f in (BASE_FRAME, root)]
    edges = _edges(bag, frames, has_stamps)
    for frame in frames:
        parents = [
            parent
            for parent, child in edges
            if child == frame and posixpath.basename(parent) not in own
        ]
        if parents:
            ranks = {name: rank for rank, name in enumerate(PARENTS)}
            parent = min(
                parents, key=lambda p: ranks.get(posixpath.basename(p), len(ranks))
            )
            path = edges[parent, frame]
            if frame.endswith(BASE_FRAME):  # the root may be next to it
                of_root = frame[: -len(BASE_FRAME)] + root
                for *_, pose in edges.get((frame, of_root), [])[-1:]:
                    if (pose != IDENTITY).any():
                        stamps, times, bases = zip(*path)
                        placed = compose(np.array(bases), pose)
                        path = list(zip(stamps, times, placed))
            return f"/tf ({parent} to {frame})", path
    return _odometry(bag, namespace, has_stamps)


def _edges(
    bag: Recording, frames: Collection[str], has_stamps: bool
) -> dict[tuple[str, str], _Poses]:
    """Collect poses of some frames by parent and child."""
    found: dict[tuple[str, str], _Poses] = {}
    channels = [one for own in topics_of(bag, "TFMessage").values() for one in own]
    written = {*frames, *(f"/{frame}" for frame in frames)}  # the latter from old tf
    for time, message in messages_of(bag, channels):
        for edge in message.edges:
            if edge.child in written:
                stamp = (has_stamps and _nanoseconds(edge)) or time
                key = edge.parent.lstrip("/"), edge.child.lstrip("/")
                found.setdefault(key, []).append((stamp, time, edge.pose))
    return found


def _odometry(bag: Recording, namespace: str, has_stamps: bool) -> _Path:
    """Find the base in an odometry, preferably odom of the namespace."""

    def rank(topic: str) -> tuple[bool, bool, str]:
        place, name = posixpath.split(topic)
        return place.strip("/") != namespace, name != "odom", name

    topics = topics_of(bag, "Odometry")
    if not topics:
        return "", []
    chosen = min(topics, key=rank)
    return chosen, [
        ((has_stamps and _nanoseconds(message.edge)) or time, time, message.edge.pose)
        for time, message in messages_of(bag, topics[chosen])
    ]


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
    stamps = np.array([_nanoseconds(point) for point in joints.points])
    motion = Motion(
        stamps / 1e9,
        tuple(joints.names),
        np.array([point.positions for point in joints.points]).reshape(shape),
        np.array(rates) if has_rates else None,
    )
    notes = [f"Motion from {topic}{more}."]
    if base and base.points:
        own, bases, base_notes = _ordered_path(_path(base))
        poses = _poses_at(own, bases, stamps)
        motion, notes = replace(motion, base_poses=poses), [*notes, *base_notes]
    return replace(motion, notes=tuple(notes))


def _path(base: Any) -> _Poses:
    """Return the poses of a base's points."""
    times = [_nanoseconds(point) for point in base.points]
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
        rows.append((0, time, joints.names, point.positions, point.velocities))
        path += [(time, time, pose) for *_, pose in (_path(base) if base else ())]
    return _joined(topic, rows, lambda _: (topic, path))
