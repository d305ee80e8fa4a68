"""The states of a robot in a recording of ROS: joints on a topic, and the base."""

from __future__ import annotations

import posixpath
from collections.abc import Callable, Collection, Sequence
from typing import Any, List, Tuple

import numpy as np

from g1_description.errors import MotionError
from g1_description.motion.files.arrays import MAX_SIZE
from g1_description.motion.files.recordings import (
    Channel,
    Recording,
    messages_of,
    topics_of,
)
from g1_description.motion.history_chunks import Stretch
from g1_description.motion.motion import Motion, sample
from g1_description.robot.assembly import BASE_FRAME, MAP, base_of
from g1_description.robot.description import Description
from g1_description.robot.transform import IDENTITY, compose

PARENTS = (MAP, "world", "odom")
"""Parent frames of a base, by preference."""

MAX_LATE = 1_000_000_000
"""Distance from the stamps around it at which a stamp is wrong, in [ns]."""

MANY = 10
"""Samples in a row that are behind where time restarts."""

FEW = 3
"""Samples in a row that may have wrong stamps."""

LATE = 100_000_000
"""Time without a base that is reported, in [ns]: the bridge publishes it every 0.05
s."""

Row = Tuple[int, int, List[str], np.ndarray, np.ndarray, np.ndarray]
"""A sample: stamp and time of recording in [ns], names, positions, velocities, efforts;
the last two may be empty."""

Poses = List[Tuple[int, int, np.ndarray]]
"""Stamps and times of recording in [ns], and poses, shape (7,)."""

BasePath = Tuple[str, Poses]
"""A path of the base: its source, and its poses."""


def nanoseconds(stamp: Any) -> int:
    """Convert a stamp or a duration to [ns]."""
    return stamp.secs * 1_000_000_000 + stamp.nsecs


def joint_rows(bag: Recording, joints: Collection[Channel]) -> list[Row]:
    """Read joint states."""
    rows: list[Row] = []
    for time, s in messages_of(bag, joints):
        # Most messages have equal names, which are kept once.
        names = rows[-1][2] if rows and rows[-1][2] == s.names else s.names
        numbers = s.positions, s.velocities, s.efforts
        rows.append((nanoseconds(s), time, names, *numbers))
    return rows


def joined_states(
    topic: str,
    rows: Sequence[Row],
    find_base: Callable[[bool], BasePath],
    is_last: bool = False,
) -> tuple[Stretch, list[str]]:
    """Join samples and the base, by stamps or times of recording.

    Args:
        topic: Where the samples are from.
        rows: The samples, in the order of the file.
        find_base: Given whether stamps count, finds the base.
        is_last: Whether the last run is read, not the first, where time goes back.

    Returns:
        The states, and messages on what is special.
    """
    stamps, times = np.array([row[:2] for row in rows]).T
    notes: list[str] = []
    has_stamps = bool(stamps.all())
    if not has_stamps:
        stamps = times
        notes.append("Some messages have no stamps: the times of recording are used.")
    kept, order_notes = ordered(stamps, "samples", is_last)
    notes += order_notes
    names, positions, *more = _table(topic, [rows[number] for number in kept])
    stamps = stamps[kept]
    source, path = find_base(has_stamps)
    poses = None
    if path:
        own, bases, base_notes = ordered_path(path, is_last)
        notes += base_notes
        if own[0] > stamps[0] + LATE:
            seconds = (own[0] - stamps[0]) / 1e9
            notes.append(
                f"There is no base pose before {seconds:.3f} s: the first one is held."
            )
        poses = poses_at(own, bases, stamps)
    states = Stretch(1, stamps, names, (), positions, more[0], poses, efforts=more[1])
    states = states.rows(np.append(np.diff(stamps) > 0, True))
    whence = f", base from {source}" if path else ""
    return states, [f"Joints from {topic}{whence}.", *notes]


def _table(
    topic: str, rows: Sequence[Row]
) -> tuple[tuple[str, ...], np.ndarray, np.ndarray | None, np.ndarray | None]:
    """Put the joints of all samples into columns.

    Returns:
        Names; positions, where missing values are the previous ones, or else the next
        ones; velocities, None unless all samples have those of all joints; efforts,
        NaN where a sample has none, None if none has any.
    """
    columns: dict[str, int] = {}
    before: list[str] = []
    for number, (_, _, names, given, *_) in enumerate(rows, 1):
        if len(given) != len(names):
            raise MotionError(
                f"Message {number} on {topic} has {len(given)} positions of "
                f"{len(names)} joints."
            )
        if names is not before:
            for name in names:
                columns.setdefault(name, len(columns))
            before = names
    if len(columns) * len(rows) > MAX_SIZE:
        raise MotionError(f"{topic} has more than {MAX_SIZE} numbers.")
    shape = len(rows), len(columns)
    positions, velocities, efforts = (np.full(shape, np.nan) for _ in range(3))
    before = []
    for row, (_, _, names, *numbers) in enumerate(rows):
        if names is not before:
            which, before = np.array([columns[name] for name in names], int), names
        for array, own in zip((positions, velocities, efforts), numbers):
            if len(own) == len(which):
                array[row, which] = own
    for turned in (positions, positions[::-1]):
        known = np.isfinite(turned)
        if not known.all():
            last = np.where(known, np.arange(len(turned))[:, np.newaxis], 0)
            np.maximum.accumulate(last, axis=0, out=last)
            turned[:] = turned[last, np.arange(turned.shape[1])]
    rates = velocities if np.isfinite(velocities).all() else None
    has_efforts = np.isfinite(efforts).any()
    return tuple(columns), positions, rates, efforts if has_efforts else None


def ordered(
    stamps: np.ndarray, label: str, is_last: bool = False
) -> tuple[np.ndarray, list[str]]:
    """Put samples in the order of their stamps, until time restarts.

    Stamps fall where messages are late, or of several publishers. Time restarts where
    one is before the ``MANY`` before it, and the ``MANY`` from it on are behind. Up to
    ``FEW`` in a row that are far from those around them are ignored.

    Args:
        stamps: In [ns], shape (n,).
        label: Name of the samples, for messages.
        is_last: Whether the last run is kept, without messages.

    Returns:
        Indices of the samples in order, and messages on ignored ones.
    """
    if is_last:  # the first one backwards
        order, _ = ordered(-stamps[::-1], label)
        return len(stamps) - 1 - order[::-1], []
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


def ordered_path(
    path: Poses, is_last: bool = False
) -> tuple[np.ndarray, np.ndarray, list[str]]:
    """Return stamps in [ns], increasing, poses, and messages on ignored ones."""
    stamps = np.array([step[0] for step in path])
    order, notes = ordered(stamps, "base poses", is_last)
    order = order[np.append(np.diff(stamps[order]) > 0, True)]
    return stamps[order], np.array([path[number][2] for number in order]), notes


def poses_at(
    own: np.ndarray, poses: np.ndarray, stamps: np.ndarray
) -> np.ndarray | None:
    """Interpolate poses at their own stamps; the first and last ones are held."""
    times = (own - own[0]) / 1e9
    base = Motion(times, (), np.empty((len(times), 0)), None, poses)
    return sample(base, (stamps - own[0]) / 1e9).base_poses


def base_path(
    bag: Recording, joints: str, robot: Description, has_stamps: bool
) -> BasePath:
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
) -> dict[tuple[str, str], Poses]:
    """Collect poses of some frames by parent and child."""
    found: dict[tuple[str, str], Poses] = {}
    channels = [one for own in topics_of(bag, "TFMessage").values() for one in own]
    written = {*frames, *(f"/{frame}" for frame in frames)}  # the latter from old tf
    for time, message in messages_of(bag, channels):
        for edge in message.edges:
            if edge.child in written:
                stamp = (has_stamps and nanoseconds(edge)) or time
                key = edge.parent.lstrip("/"), edge.child.lstrip("/")
                found.setdefault(key, []).append((stamp, time, edge.pose))
    return found


def _odometry(bag: Recording, namespace: str, has_stamps: bool) -> BasePath:
    """Find the base in an odometry, preferably odom of the namespace."""

    def rank(topic: str) -> tuple[bool, bool, str]:
        place, name = posixpath.split(topic)
        return place.strip("/") != namespace, name != "odom", name

    topics = topics_of(bag, "Odometry")
    if not topics:
        return "", []
    chosen = min(topics, key=rank)
    return chosen, [
        ((has_stamps and nanoseconds(message.edge)) or time, time, message.edge.pose)
        for time, message in messages_of(bag, topics[chosen])
    ]
