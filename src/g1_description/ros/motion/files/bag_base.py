"""Where the base of a robot is in a rosbag: on TF, or else in an odometry."""

from __future__ import annotations

import posixpath
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from g1_description.core.errors import MotionError
from g1_description.core.motion.sampling import sample
from g1_description.core.motion.trajectory import Trajectory
from g1_description.core.robot.assembly import base_of
from g1_description.core.robot.description import Description
from g1_description.core.transform import IDENTITY, compose

from .bag_messages import kind_of, read_messages, rising
from .bag_records import MAX_MESSAGES, Bag, Topic

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
