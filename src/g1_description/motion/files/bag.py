"""Rosbags, read by the library rosbags, which needs no ROS.

The message definitions in a bag are not used: messages are identified by md5 sum and
read with own definitions, so nothing in a bag becomes code.
"""

from __future__ import annotations

import bz2
import posixpath
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import replace
from functools import lru_cache
from typing import TYPE_CHECKING, Any, List, Tuple

import numpy as np

from g1_description.errors import MotionError, cause
from g1_description.motion.files.arrays import MAX_SIZE
from g1_description.motion.files.format import Format
from g1_description.motion.files.source import MotionSource
from g1_description.motion.motion import Motion, sample
from g1_description.robot.assembly import base_of
from g1_description.robot.description import Description
from g1_description.robot.transform import IDENTITY, compose
from g1_description.text import listed

if TYPE_CHECKING:
    from rosbags.interfaces import Connection
    from rosbags.rosbag1 import Reader
    from rosbags.typesys.store import Typestore

MAGIC = b"#ROSBAG V"

MAX_MESSAGES = 250_000
"""Most messages on the topics that are read."""

MAX_CHUNK = 100_000_000
"""Largest size of a decompressed chunk in bytes: rosbag writes 0.8 MB."""

BASE_FRAME = "base_link"

PARENTS = ("map", "world", "odom")
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

_STAMP = "uint32 seq\nuint32 secs\nuint32 nsecs\n"
_DURATION = "int32 secs\nint32 nsecs\n"
_JOINTS = f"{_STAMP}string frame\nstring[] names\n"

DEFINITIONS = {
    "Pose": "float64[7] numbers",
    "Twist": "float64[6] numbers",
    "Edge": f"{_STAMP}string parent\nstring child\nfloat64[7] pose",
    "JointPoint": f"float64[] positions\nfloat64[] velocities\n"
    f"float64[] accelerations\nfloat64[] efforts\n{_DURATION}",
    "BasePoint": "Pose[] poses\nTwist[] velocities\nTwist[] accelerations\n"
    f"{_DURATION}",
    "JointTrajectory": f"{_JOINTS}JointPoint[] points",
    "BaseTrajectory": f"{_JOINTS}BasePoint[] points",
    "RobotTrajectory": "JointTrajectory joints\nBaseTrajectory base",
    "JointState": f"{_JOINTS}float64[] positions\nfloat64[] velocities\n"
    "float64[] efforts",
    "TFMessage": "Edge[] edges",
    "Odometry": "Edge edge\nfloat64[78] covariances_and_twist",
}
"""Definitions that match the bytes of ROS' messages with few fields: reading ten
minutes of TF takes 2 s instead of 13 s."""

MD5_SUMS = {
    "3066dcd76a6cfaef579bd0f34173e9fd": "JointState",
    "94810edda583a504dfda3829e70d7eec": "TFMessage",
    "cd5e73d190d741a2f92e81eda573aca7": "Odometry",
    "65b4f94a94d1ed67169da35a02f33d3f": "JointTrajectory",
    "dfa9556423d709a3729bcef664bddf67": "RobotTrajectory",
}
"""Message types by md5 sum: some exist under several names, as in moveit_msgs, tf and
this package."""

JOINTS = ("JointState", "JointTrajectory", "RobotTrajectory")
"""Message types with joints."""


def recognise(source: MotionSource) -> bool:
    """Return whether a file is a rosbag."""
    return source.head.startswith(MAGIC)


def read(source: MotionSource, robot: Description) -> Motion:
    """Read a motion: joints, and the base on TF or in an odometry.

    Raises:
        MotionError: If the bag is damaged or has no motion on the topic.
    """
    try:
        with _opened(source) as bag:
            return _motion(bag, robot, source.options.topic)
    except MotionError:
        raise
    # Any error of rosbags or a decompressor on a damaged bag.
    except Exception as error:
        raise MotionError(f"The bag cannot be read: {cause(error)}.") from error


def _opened(source: MotionSource) -> Reader:
    """Open a bag with a limit on decompressed chunks."""
    # Not at the top: it takes 0.05 s, and few programs read bags.
    import lz4.frame
    from rosbags.rosbag1 import Reader

    decompressors = {
        bz2.decompress: bz2.BZ2Decompressor,
        lz4.frame.decompress: lz4.frame.LZ4FrameDecompressor,
    }

    class BoundedReader(Reader):
        """Decompresses each chunk once, and at most ``MAX_CHUNK`` bytes of it."""

        def messages(self, connections: Any = (), *_: Any) -> Any:
            # In the order of the file: recorded times go back at a reset, and by them
            # the messages of two runs would be mixed.
            entries = [e for known in connections for e in self.indexes[known.id]]
            entries.sort(key=lambda entry: (entry.chunk_pos, entry.offset))
            self.indexes[-1] = entries
            return super().messages([next(iter(connections))._replace(id=-1)])

        def read_chunk(self) -> Any:
            chunk = super().read_chunk()
            make = decompressors.get(chunk.decompressor)
            if make is None:
                return chunk

            def unpacked(data: bytes) -> bytes:
                found: bytes = make().decompress(data, MAX_CHUNK)
                if len(found) == MAX_CHUNK:
                    most = f"{MAX_CHUNK // 10**6} MB"
                    raise MotionError(f"A chunk of the bag has more than {most}.")
                return found

            return chunk._replace(decompressor=unpacked)

    return BoundedReader(source.path)


@lru_cache(maxsize=None)
def _typestore() -> Typestore:
    """Compile ``DEFINITIONS``."""
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    store = get_typestore(Stores.EMPTY)
    for name, definition in DEFINITIONS.items():
        store.register(get_types_from_msg(definition, f"g1/msg/{name}"))
    return store


def _kind(connection: Connection) -> str:
    """Return the type of messages in ``DEFINITIONS``, or an empty string."""
    return MD5_SUMS.get(connection.digest, "")


def _topics(bag: Reader, *kinds: str) -> dict[str, list[Connection]]:
    """Find the topics with messages of some types."""
    found: dict[str, list[Connection]] = {}
    for connection in bag.connections:
        if connection.msgcount and _kind(connection) in kinds:
            own = found.setdefault(connection.topic, [])
            if not own or _kind(own[0]) == _kind(connection):
                own.append(connection)
    return found


def _messages(
    bag: Reader, connections: Collection[Connection]
) -> Iterator[tuple[int, Any]]:
    """Yield times of recording in [ns], and messages."""
    if not connections:
        return
    if sum(connection.msgcount for connection in connections) > MAX_MESSAGES:
        raise MotionError(
            f"The bag has more than {MAX_MESSAGES} messages on the relevant topics. "
            "Reduce it with 'rosbag filter'."
        )
    store = _typestore()
    for connection, time, data in bag.messages(connections):
        try:
            yield time, store.deserialize_ros1(data, f"g1/msg/{_kind(connection)}")
        except Exception as error:  # any error of struct or numpy on damaged bytes
            problem = f"a message is damaged: {cause(error)}"
            raise MotionError(f"On {connection.topic} {problem}.") from error


def _nanoseconds(stamp: Any) -> int:
    """Convert a stamp or a duration to [ns]."""
    return stamp.secs * 1_000_000_000 + stamp.nsecs


def _motion(bag: Reader, robot: Description, topic: str | None) -> Motion:
    """Read the motion on a topic, or on the usual one."""
    topics = _topics(bag, *JOINTS)
    name = _chosen(bag, topics, topic)
    joints = topics.pop(name)
    messages = _messages(bag, joints)
    if _kind(joints[0]) == "JointState":
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


def _publishers(joints: Collection[Connection], rows: Sequence[_Row]) -> list[str]:
    """Report several publishers of the same joints."""
    orders = {tuple(names) for _, _, names, *_ in rows}
    senders = {getattr(connection.ext, "callerid", None) for connection in joints}
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


def _chosen(bag: Reader, topics: Collection[str], name: str | None) -> str:
    """Choose the topic with the joints."""
    known = (
        listed(topics)
        or listed(
            f"{c.topic} ({c.msgtype.replace('/msg/', '/')})" for c in bag.connections
        )
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


def _base(bag: Reader, joints: str, robot: Description, has_stamps: bool) -> _Path:
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
    bag: Reader, frames: Collection[str], has_stamps: bool
) -> dict[tuple[str, str], _Poses]:
    """Collect poses of some frames by parent and child."""
    found: dict[tuple[str, str], _Poses] = {}
    connections = [one for own in _topics(bag, "TFMessage").values() for one in own]
    written = {*frames, *(f"/{frame}" for frame in frames)}  # the latter from old tf
    for time, message in _messages(bag, connections):
        for edge in message.edges:
            if edge.child in written:
                stamp = (has_stamps and _nanoseconds(edge)) or time
                key = edge.parent.lstrip("/"), edge.child.lstrip("/")
                found.setdefault(key, []).append((stamp, time, edge.pose))
    return found


def _odometry(bag: Reader, namespace: str, has_stamps: bool) -> _Path:
    """Find the base in an odometry, preferably odom of the namespace."""

    def rank(topic: str) -> tuple[bool, bool, str]:
        place, name = posixpath.split(topic)
        return place.strip("/") != namespace, name != "odom", name

    topics = _topics(bag, "Odometry")
    if not topics:
        return "", []
    chosen = min(topics, key=rank)
    return chosen, [
        ((has_stamps and _nanoseconds(message.edge)) or time, time, message.edge.pose)
        for time, message in _messages(bag, topics[chosen])
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


FORMAT = Format("bag", recognise, read, (".bag",))
