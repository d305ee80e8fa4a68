"""A motion from a rosbag."""

from __future__ import annotations

import posixpath
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from g1_description.errors import MotionError
from g1_description.motion.files.arrays import MAX_SIZE
from g1_description.motion.files.bag_messages import JointSample, Points
from g1_description.motion.files.bag_records import (
    MAX_MESSAGES,
    Bag,
    Topic,
    damage,
    kind_of,
    open_bag,
    read_messages,
    rising,
)
from g1_description.motion.motion import Motion
from g1_description.motion.trajectory import Trajectory, sample
from g1_description.robot.assembly import base_of
from g1_description.robot.description import Description
from g1_description.robot.transform import IDENTITY, compose
from g1_description.text import listed

BASE_FRAME = "base_link"

MAP = "map"

ABOVE = (MAP, "world", "odom")
"""Frames that a base is in, the best one first."""


@dataclass(frozen=True)
class BasePath:
    """Where a base is at rising times."""

    stamps: np.ndarray
    """In [ns], shape (n,)."""

    poses: np.ndarray
    """T_map_base, shape (n, 7)."""

    source: str
    """Where it is from, for a message."""

    def at(self, stamps: np.ndarray) -> np.ndarray:
        """Interpolate; before the first pose and after the last one it rests.

        Args:
            stamps: In [ns], shape (m,).
        """
        times = (self.stamps - self.stamps[0]) / 1e9
        path = Trajectory(times, (), np.empty((len(times), 0)), None, self.poses)
        found = sample(path, (stamps - self.stamps[0]) / 1e9).base_poses
        assert found is not None
        return found


def base_of_bag(
    bag: Bag, joints: Topic, robot: Description, has_stamps: bool
) -> BasePath | None:
    """Find where the base is.

    Args:
        bag: The bag.
        joints: The topic with the joints, in whose namespace the base is.
        robot: The robot.
        has_stamps: Whether the stamps of messages count, not when they were recorded.

    Raises:
        MotionError: If the bag is damaged.
    """
    namespace = posixpath.dirname(joints.name).strip("/")
    root, _ = base_of(robot)
    own = {*robot.link_names, BASE_FRAME} - {*ABOVE}
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
            path = path_of(edges[parent, frame], f"/tf ({parent} to {frame})")
            return _moved_to_root(path, edges.get((frame, frame_of(frame, root))))
    return _odometry(bag, namespace, has_stamps)


def frame_of(base: str, root: str) -> str:
    """Name the root's frame beside that of the base."""
    return base[: -len(BASE_FRAME)] + root if base.endswith(BASE_FRAME) else root


def _rank(parent: str) -> int:
    """Return how good a frame is as the one above the base; less is better."""
    name = posixpath.basename(parent)
    return ABOVE.index(name) if name in ABOVE else len(ABOVE)


def _edges(
    bag: Bag, frames: Sequence[str], has_stamps: bool
) -> dict[tuple[str, str], list[tuple[int, np.ndarray]]]:
    """Collect stamps and poses of the edges above some frames."""
    topics = [topic for topic in bag.counts() if kind_of(topic) == "TFMessage"]
    found: dict[tuple[str, str], list[tuple[int, np.ndarray]]] = {}
    count = 0
    for message, edges in read_messages(bag, topics):
        for edge in edges:
            child = edge.child.lstrip("/")
            if child in frames:
                count += 1
                if count > MAX_MESSAGES:
                    raise MotionError(f"TF has more than {MAX_MESSAGES} base poses.")
                stamp = edge.stamp if has_stamps and edge.stamp else message.time
                parent = edge.parent.lstrip("/")
                found.setdefault((parent, child), []).append((stamp, edge.pose))
    return found


def path_of(samples: Sequence[tuple[int, np.ndarray]], source: str) -> BasePath:
    """Make a path of the samples whose stamps rise.

    Args:
        samples: Stamps in [ns] and poses, shape (7,).
        source: Where they are from, for a message.
    """
    stamps = np.array([stamp for stamp, _ in samples])
    kept, _ = rising(stamps)
    return BasePath(stamps[kept], np.array([samples[k][1] for k in kept]), source)


def _moved_to_root(
    path: BasePath, edge: Sequence[tuple[int, np.ndarray]] | None
) -> BasePath:
    """Give the root's poses where base_link is not in the same place."""
    if not edge or (edge[-1][1] == IDENTITY).all():
        return path
    return BasePath(path.stamps, compose(path.poses, edge[-1][1]), path.source)


def _odometry(bag: Bag, namespace: str, has_stamps: bool) -> BasePath | None:
    """Find the base in an odometry: that of the namespace, called odom if there is."""
    topics = [topic for topic in bag.counts() if kind_of(topic) == "Odometry"]
    if not topics:
        return None

    def rank(topic: Topic) -> tuple[bool, bool, str]:
        place, name = posixpath.split(topic.name)
        return place.strip("/") != namespace, name != "odom", name

    chosen = min(topics, key=rank)
    samples = [
        (edge.stamp if has_stamps and edge.stamp else message.time, edge.pose)
        for message, edges in read_messages(bag, [chosen])
        for edge in edges
    ]
    return path_of(samples, chosen.name)


class Samples:
    """The joints of one message after the other, while they are not too many."""

    def __init__(self, topic: Topic) -> None:
        """Begin without a message.

        Args:
            topic: That of the messages.
        """
        self.topic = topic
        self._states: list[JointSample] = []
        self._times: list[int] = []
        self._columns: dict[str, int] = {}

    def add(self, time: int, state: JointSample) -> None:
        """Add a message.

        Args:
            time: When it was recorded, in [ns].
            state: What it says.

        Raises:
            MotionError: If it has not one position for each joint, or there are now
                more numbers than a motion has.
        """
        count, columns = len(self._states) + 1, self._columns
        if len(state.positions) != len(state.names):
            raise MotionError(
                f"Message {count} on {self.topic.name} has {len(state.positions)} "
                f"positions of {len(state.names)} joints."
            )
        if not self._states or state.names is not self._states[-1].names:
            for name in state.names:
                columns.setdefault(name, len(columns))
        if len(columns) * count > MAX_SIZE:
            raise MotionError(f"{self.topic.name} has more than {MAX_SIZE} numbers.")
        self._states.append(state)
        self._times.append(time)

    def times(self) -> np.ndarray:
        """Return the stamps, and when the messages were recorded, both in [ns]."""
        return np.array([[state.stamp for state in self._states], self._times])

    def table(self) -> tuple[tuple[str, ...], np.ndarray, np.ndarray | None]:
        """Put the joints of all messages into columns.

        Returns:
            Names; positions, where a message does not name a joint those before, or
            else the first ones; velocities, None unless all messages have those of all
            joints.
        """
        shape = len(self._states), len(self._columns)
        positions, velocities = np.full((2, *shape), np.nan)
        for row, state in enumerate(self._states):
            which = [self._columns[name] for name in state.names]
            positions[row, which] = state.positions
            if len(state.velocities) == len(which):
                velocities[row, which] = state.velocities
        is_whole = np.isfinite(velocities).all()
        return (
            tuple(self._columns),
            _filled(positions),
            velocities if is_whole else None,
        )


def _filled(positions: np.ndarray) -> np.ndarray:
    """Fill what is not finite with what was before it, else with what comes next."""
    for turned in (positions, positions[::-1]):
        known = np.isfinite(turned)
        if not known.all():
            rows = np.where(known, np.arange(len(turned))[:, np.newaxis], 0)
            np.maximum.accumulate(rows, axis=0, out=rows)
            turned[:] = turned[rows, np.arange(turned.shape[1])]
    return positions


USUAL = ("joint_states", "motion", "joint_trajectory", "joint_commands")
"""Names of topics with a robot's joints, the first one counts."""

LATE = 100_000_000
"""Time without a base that is told, in [ns]: the bridge sends it each 0.05 s."""

JOINTS = ("JointState", "RobotTrajectory", "JointTrajectory")


def read_bag(path: Path, robot: Description, topic: str | None = None) -> Motion:
    """Read a motion from a bag.

    Args:
        path: The bag.
        robot: The robot.
        topic: Name of the topic with the joints; None: the first of ``USUAL``, or the
            only one.

    Raises:
        MotionError: If the bag is damaged, or has no such topic or no motion there.
        OSError: If it cannot be read.
    """
    with path.open("rb") as file:
        try:
            bag = open_bag(path, file)
            chosen, others = _chosen(bag, topic)
            read = _states if kind_of(chosen) == "JointState" else _trajectory
            motion = read(bag, chosen, robot)
        except (MotionError, OSError):
            raise
        # Whatever a damaged bag makes struct and the libraries of compression raise.
        except Exception as error:
            raise damage(error) from error
    others = [name for name in others if name != chosen.name]
    also = f" It also has joints on {listed(others)}." if others else ""
    return Motion(motion.trajectory, (f"{motion.notes[0]}{also}", *motion.notes[1:]))


def _chosen(bag: Bag, name: str | None) -> tuple[Topic, list[str]]:
    """Choose the topic with the joints; return the names of all such topics too."""
    topics = [topic for topic in bag.counts() if kind_of(topic) in JOINTS]
    names = [topic.name for topic in topics]
    if name is not None:
        wanted = [topic for topic in topics if topic.name.strip("/") == name.strip("/")]
        if not wanted:
            raise MotionError(
                f"The bag has no joints on {name}; it has {_what(bag, names)}."
            )
        return wanted[0], names
    for usual in USUAL:
        found = [t for t in topics if t.name.rpartition("/")[2] == usual]
        plain = [t for t in found if t.name.strip("/") == usual] or found
        if len({topic.name for topic in plain}) > 1:
            raise MotionError(
                f"The bag has several robots, {listed(t.name for t in plain)}: name "
                "the topic of one."
            )
        if plain:
            return plain[0], names
    if len(topics) != 1:
        raise MotionError(
            f"The bag has no {listed(USUAL)}: name the topic with the joints; it has "
            f"{_what(bag, names)}."
        )
    return topics[0], names


def _what(bag: Bag, joints: Sequence[str]) -> str:
    """Name the topics with joints, or else what there is."""
    return (
        listed(joints)
        or listed(f"{topic.name} ({topic.kind})" for topic in bag.counts())
        or "nothing"
    )


def _states(bag: Bag, topic: Topic, robot: Description) -> Motion:
    """Read joint states or commands, and where the base is."""
    found = Samples(topic)
    for message, (state,) in read_messages(bag, [topic]):
        found.add(message.time, state)
    return _joined(found, lambda stamped: base_of_bag(bag, topic, robot, stamped))


def _stream(bag: Bag, topic: Topic) -> Motion:
    """Read trajectories of one point each, which planners send one after the other."""
    found, bases = Samples(topic), []
    for number, (message, parts) in enumerate(read_messages(bag, [topic]), 1):
        joints: Points = parts[0]
        if any(len(part.times) > 1 for part in parts) or not joints.times:
            raise MotionError(
                f"Message {number} on {topic.name} has not one point, as the first has."
            )
        positions, velocities = joints.positions[0], joints.velocities[0]
        state = JointSample(0, joints.names, positions, velocities)
        found.add(message.time, state)
        bases += [(message.time, part.positions[0]) for part in parts[1:] if part.times]
    base = path_of(bases, topic.name) if bases else None
    return _joined(found, lambda _: base)


def _joined(found: Samples, find_base: Callable[[bool], BasePath | None]) -> Motion:
    """Join the joints and the base."""
    names, positions, velocities = found.table()
    (stamps, times), notes = found.times(), []
    has_stamps = bool(stamps.all())
    if not has_stamps:
        stamps = times
        notes.append("Some messages have no stamps: the times of the recording count.")
    kept, goes_back = rising(stamps)
    if goes_back:
        seconds = (stamps[kept[-1]] - stamps[0]) / 1e9
        notes.append(f"Time goes back after {seconds:.3f} s: the rest is left out.")
    stamps = stamps[kept]
    base = find_base(has_stamps)
    if base and base.stamps[0] > stamps[0] + LATE:
        seconds = (base.stamps[0] - stamps[0]) / 1e9
        notes.append(f"The base is known from {seconds:.3f} s on; before it rests.")
    trajectory = Trajectory(
        (stamps - stamps[0]) / 1e9,
        names,
        positions[kept],
        None if velocities is None else velocities[kept],
        base and base.at(stamps),
    )
    whence = f", the base that of {base.source}" if base else ""
    return Motion(
        trajectory, (f"The joints are those of {found.topic.name}{whence}.", *notes)
    )


def _trajectory(bag: Bag, topic: Topic, robot: Description) -> Motion:
    """Read the first message of a topic with whole trajectories."""
    count = bag.counts()[topic]
    parts: list[Points] = next(read_messages(bag, [topic]))[1]
    if count > 1 and len(parts[0].times) == 1:
        return _stream(bag, topic)
    more = f", the first of {count} messages" if count > 1 else ""
    notes = (f"The motion is that of {topic.name}{more}.",)
    joints, bases = parts[0], parts[1:]
    base = bases[0] if bases and bases[0].times else None
    if not joints.times:
        raise MotionError(f"The first message on {topic.name} has no points of joints.")
    times = np.array(joints.times)
    return Motion(
        Trajectory(
            times,
            joints.names,
            _rows(joints.positions, len(joints.names)),
            _rows(joints.velocities, len(joints.names))
            if all(map(len, joints.velocities)) and joints.names
            else None,
            _base_poses(base, times) if base else None,
        ),
        notes,
    )


def _rows(rows: Sequence[np.ndarray], width: int) -> np.ndarray:
    """Stack rows of a width."""
    return np.array(rows).reshape(len(rows), width)


def _base_poses(base: Points, times: np.ndarray) -> np.ndarray:
    """Find the base at the times of the joints."""
    poses = _rows(base.positions, 7)
    path = Trajectory(np.array(base.times), (), np.empty((len(poses), 0)), None, poses)
    return sample(path, times).base_poses
