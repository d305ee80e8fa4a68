"""Rosbags, read by the library rosbags, which needs no ROS.

A bag brings definitions of its messages. They are not used: md5 sums identify the
messages, which are read by definitions of ours, so nothing in a bag becomes code.
"""

from __future__ import annotations

import bz2
import posixpath
from collections.abc import Callable, Collection, Iterator, Sequence
from functools import lru_cache
from typing import TYPE_CHECKING, Any, List, Tuple

import numpy as np

from g1_description.errors import MotionError, cause
from g1_description.motion.files.source import MAX_SIZE, MotionSource
from g1_description.motion.motion import Motion
from g1_description.motion.trajectory import Trajectory, sample
from g1_description.robot.assembly import base_of
from g1_description.robot.description import Description
from g1_description.robot.transform import IDENTITY, compose
from g1_description.text import listed

ENDINGS = (".bag",)

if TYPE_CHECKING:
    from rosbags.interfaces import Connection
    from rosbags.rosbag1 import Reader
    from rosbags.typesys.store import Typestore

MAGIC = b"#ROSBAG V"

MAX_MESSAGES = 250_000
"""Most messages on the topics that are read."""

MAX_CHUNK = 100_000_000
"""Most bytes of a compressed chunk that are unpacked: rosbag makes chunks of 0.8 MB."""

BASE_FRAME = "base_link"

PARENTS = ("map", "world", "odom")
"""Frames that a base is in, the best one first."""

USUAL = ("joint_states", "motion", "joint_trajectory", "joint_commands")
"""Names of topics with a robot's joints, the first one counts."""

LATE = 100_000_000
"""Time without a base that is reported, in [ns]: the bridge sends it each 0.05 s."""

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
"""Messages with the bytes of ROS' and as few fields as these allow: to read ten minutes
of TF takes 2 s so, and 13 s with ROS' own definitions."""

MD5_SUMS = {
    "3066dcd76a6cfaef579bd0f34173e9fd": "JointState",
    "94810edda583a504dfda3829e70d7eec": "TFMessage",
    "cd5e73d190d741a2f92e81eda573aca7": "Odometry",
    "65b4f94a94d1ed67169da35a02f33d3f": "JointTrajectory",
    "dfa9556423d709a3729bcef664bddf67": "RobotTrajectory",
}
"""Messages by the md5 sums of ROS' definitions: moveit_msgs, tf and this package have
names of their own for some."""

JOINTS = ("JointState", "JointTrajectory", "RobotTrajectory")
"""Messages with joints."""


def recognise(source: MotionSource) -> bool:
    """Return whether a file is a rosbag."""
    return source.head.startswith(MAGIC)


def read(source: MotionSource, robot: Description) -> Motion:
    """Read a motion: joints, and the base on TF or in an odometry.

    Raises:
        MotionError: If the bag is damaged, or has no motion on the topic.
    """
    try:
        with _opened(source) as bag:
            return _motion(bag, robot, source.topic)
    except MotionError:
        raise
    # Whatever a damaged bag makes rosbags and the libraries of compression raise.
    except Exception as error:
        raise MotionError(f"The bag cannot be read: {cause(error)}.") from error


def _opened(source: MotionSource) -> Reader:
    """Open a bag with a reader that unpacks no chunk without bound."""
    # Not at the top: it takes 0.05 s, and few programs read bags.
    import lz4.frame
    from rosbags.rosbag1 import Reader

    decompressors = {
        bz2.decompress: bz2.BZ2Decompressor,
        lz4.frame.decompress: lz4.frame.LZ4FrameDecompressor,
    }

    class BoundedReader(Reader):
        """Unpacks ``MAX_CHUNK`` bytes of a chunk at most, and each chunk once."""

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
    """Name a connection's messages as ``DEFINITIONS`` does; others are empty."""
    return MD5_SUMS.get(connection.digest, "")


def _topics(bag: Reader, *kinds: str) -> dict[str, list[Connection]]:
    """Find the topics that have messages of some kinds, each with one kind."""
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
    """Read messages, and when they were recorded, in [ns]."""
    if not connections:
        return
    if sum(connection.msgcount for connection in connections) > MAX_MESSAGES:
        raise MotionError(
            f"The bag has more than {MAX_MESSAGES} messages where the motion may be: "
            "'rosbag filter' makes a bag of the motion's topics alone."
        )
    store = _typestore()
    for connection, time, data in bag.messages(connections):
        try:
            yield time, store.deserialize_ros1(data, f"g1/msg/{_kind(connection)}")
        except Exception as error:  # whatever bytes make struct and numpy raise
            problem = f"a message is damaged: {cause(error)}"
            raise MotionError(f"On {connection.topic} {problem}.") from error


def _nanoseconds(stamp: Any) -> int:
    """Give a stamp or a duration in [ns]."""
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
            # Most messages have equal names, which need be kept but once.
            names = rows[-1][2] if rows and rows[-1][2] == state.names else state.names
            stamp = _nanoseconds(state)
            rows.append((stamp, time, names, state.positions, state.velocities))
        motion = _joined(name, rows, lambda has: _base(bag, name, robot, has))
    else:
        motion = _trajectory(name, list(messages))
    also = f" It also has joints on {listed(topics)}." if topics else ""
    return Motion(motion.trajectory, (f"{motion.notes[0]}{also}", *motion.notes[1:]))


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
        raise MotionError(f"The bag has no joints on {name}; it has {known}.")
    for usual in USUAL:
        found = [topic for topic in topics if posixpath.basename(topic) == usual]
        plain = [topic for topic in found if topic.strip("/") == usual] or found
        if len(plain) > 1:
            raise MotionError(
                f"The bag has several robots, {listed(plain)}: name the topic of one."
            )
        if plain:
            return plain[0]
    if len(topics) != 1:
        raise MotionError(
            f"The bag has no {listed(USUAL)}: name the topic with the joints; it has "
            f"{known}."
        )
    return next(iter(topics))


_Row = Tuple[int, int, List[str], np.ndarray, np.ndarray]
"""A sample: its stamp, when it was recorded, both in [ns], names, positions and
velocities."""

_Path = Tuple[str, List[Tuple[int, np.ndarray]]]
"""A path of the base: where it is from, stamps in [ns] and poses, shape (7,)."""


def _joined(
    topic: str, rows: Sequence[_Row], find_base: Callable[[bool], _Path]
) -> Motion:
    """Join samples and the base, which is found by its stamps or times of recording."""
    names, positions, velocities = _table(topic, rows)
    stamps, notes = np.array([row[0] for row in rows]), []
    has_stamps = bool(stamps.all())
    if not has_stamps:
        stamps = np.array([row[1] for row in rows])
        notes.append("Some messages have no stamps: the times of the recording count.")
    kept, goes_back = _rising(stamps)
    if goes_back:
        seconds = (stamps[kept[-1]] - stamps[0]) / 1e9
        notes.append(f"Time goes back after {seconds:.3f} s: the rest is left out.")
    stamps = stamps[kept]
    source, path = find_base(has_stamps)
    if path and path[0][0] > stamps[0] + LATE:
        seconds = (path[0][0] - stamps[0]) / 1e9
        notes.append(f"The base is known from {seconds:.3f} s on; before it rests.")
    trajectory = Trajectory(
        (stamps - stamps[0]) / 1e9,
        names,
        positions[kept],
        None if velocities is None else velocities[kept],
        _poses_at(path, stamps) if path else None,
    )
    whence = f", the base that of {source}" if path else ""
    return Motion(trajectory, (f"The joints are those of {topic}{whence}.", *notes))


def _table(
    topic: str, rows: Sequence[_Row]
) -> tuple[tuple[str, ...], np.ndarray, np.ndarray | None]:
    """Put the joints of all samples into columns.

    Returns:
        Names; positions, where a sample does not name a joint those before, or else the
        first ones; velocities, None unless all samples have those of all joints.
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
    is_whole = np.isfinite(velocities).all()
    return tuple(columns), _filled(positions), velocities if is_whole else None


def _filled(positions: np.ndarray) -> np.ndarray:
    """Fill what is not finite with what was before it, else with what comes next."""
    for turned in (positions, positions[::-1]):
        known = np.isfinite(turned)
        if not known.all():
            rows = np.where(known, np.arange(len(turned))[:, np.newaxis], 0)
            np.maximum.accumulate(rows, axis=0, out=rows)
            turned[:] = turned[rows, np.arange(turned.shape[1])]
    return positions


def _rising(stamps: np.ndarray) -> tuple[np.ndarray, bool]:
    """Choose the samples whose stamps rise, until they go back.

    Returns:
        Their numbers, of equal stamps the last one; and whether time goes back.
    """
    back = np.flatnonzero(np.diff(stamps) < 0)
    whole = stamps[: back[0] + 1] if back.size else stamps
    return np.flatnonzero(np.append(np.diff(whole) > 0, True)), bool(back.size)


def _poses_at(
    path: Sequence[tuple[int, np.ndarray]], stamps: np.ndarray
) -> np.ndarray | None:
    """Interpolate a path; before its first pose and after its last one it rests."""
    own = np.array([stamp for stamp, _ in path])
    kept, _ = _rising(own)
    times = (own[kept] - own[0]) / 1e9
    poses = np.array([path[number][1] for number in kept])
    base = Trajectory(times, (), np.empty((len(times), 0)), None, poses)
    return sample(base, (stamps - own[0]) / 1e9).base_poses


def _base(bag: Reader, joints: str, robot: Description, has_stamps: bool) -> _Path:
    """Find where the base is: on TF, else in an odometry.

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
            parent = min(parents, key=_rank)
            path = edges[parent, frame]
            if frame.endswith(BASE_FRAME):  # the root may be next to it
                of_root = frame[: -len(BASE_FRAME)] + root
                for _, pose in edges.get((frame, of_root), [])[-1:]:
                    if (pose != IDENTITY).any():
                        stamps, bases = zip(*path)
                        path = list(zip(stamps, compose(np.array(bases), pose)))
            return f"/tf ({parent} to {frame})", path
    return _odometry(bag, namespace, has_stamps)


def _rank(parent: str) -> int:
    """Return how good a frame is as the one above the base; less is better."""
    name = posixpath.basename(parent)
    return PARENTS.index(name) if name in PARENTS else len(PARENTS)


def _edges(
    bag: Reader, frames: Collection[str], has_stamps: bool
) -> dict[tuple[str, str], list[tuple[int, np.ndarray]]]:
    """Collect stamps and poses of some frames by parent and child."""
    found: dict[tuple[str, str], list[tuple[int, np.ndarray]]] = {}
    connections = [one for own in _topics(bag, "TFMessage").values() for one in own]
    written = {*frames, *(f"/{frame}" for frame in frames)}  # the latter by old tf
    for time, message in _messages(bag, connections):
        for edge in message.edges:
            if edge.child in written:
                stamp = (has_stamps and _nanoseconds(edge)) or time
                key = edge.parent.lstrip("/"), edge.child.lstrip("/")
                found.setdefault(key, []).append((stamp, edge.pose))
    return found


def _odometry(bag: Reader, namespace: str, has_stamps: bool) -> _Path:
    """Find the base in an odometry: that of the namespace, called odom if there is."""

    def rank(topic: str) -> tuple[bool, bool, str]:
        place, name = posixpath.split(topic)
        return place.strip("/") != namespace, name != "odom", name

    topics = _topics(bag, "Odometry")
    if not topics:
        return "", []
    chosen = min(topics, key=rank)
    return chosen, [
        ((has_stamps and _nanoseconds(message.edge)) or time, message.edge.pose)
        for time, message in _messages(bag, topics[chosen])
    ]


def _trajectory(topic: str, messages: Sequence[tuple[int, Any]]) -> Motion:
    """Make a motion of the first trajectory, or of all if each has one point."""
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
    trajectory = Trajectory(
        stamps / 1e9,
        tuple(joints.names),
        np.array([point.positions for point in joints.points]).reshape(shape),
        np.array(rates) if has_rates else None,
        _poses_at(_path(base), stamps) if base and base.points else None,
    )
    return Motion(trajectory, (f"The motion is that of {topic}{more}.",))


def _path(base: Any) -> list[tuple[int, np.ndarray]]:
    """Give stamps in [ns] and poses of a base's points."""
    return [(_nanoseconds(point), point.poses[0].numbers) for point in base.points]


def _check_points(topic: str, joints: Any, base: Any) -> None:
    """Check how many numbers the points of a trajectory have."""
    for number, point in enumerate(joints.points, 1):
        for values in (point.positions, point.velocities):
            is_left_out = values is point.velocities and not len(values)
            if len(values) != len(joints.names) and not is_left_out:
                raise MotionError(
                    f"On {topic}: Point {number} has {len(values)} numbers, not "
                    f"{len(joints.names)}."
                )
    for number, point in enumerate(base.points if base else (), 1):
        if len(point.poses) != 1:
            raise MotionError(
                f"On {topic}: Point {number} has {len(point.poses)} poses of the base."
            )


def _stream(topic: str, parts: Sequence[tuple[int, Any, Any]]) -> Motion:
    """Make a motion of configurations that a planner sent one after the other."""
    rows, path = [], []
    for number, (time, joints, base) in enumerate(parts, 1):
        if len(joints.points) != 1 or (base and len(base.points) > 1):
            raise MotionError(
                f"Message {number} on {topic} has not one point, as the first has."
            )
        point = joints.points[0]
        rows.append((0, time, joints.names, point.positions, point.velocities))
        path += [(time, pose) for _, pose in (_path(base) if base else ())]
    return _joined(topic, rows, lambda _: (topic, path))
