"""A motion from a rosbag."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from g1_description.core.errors import MotionError
from g1_description.core.motion.motion import Motion
from g1_description.core.motion.sampling import sample
from g1_description.core.motion.trajectory import Trajectory
from g1_description.core.robot.description import Description
from g1_description.core.text import listed
from g1_description.ros.wire.motions import JointSample, Points

from .bag_base import BasePath, base_of_bag, path_of
from .bag_messages import kind_of, read_messages, rising
from .bag_records import Bag, Topic, damage, open_bag
from .bag_samples import Samples

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
    """Join the joints and the base.

    Args:
        found: The joints.
        find_base: Finds the base; takes whether the stamps of messages count.
    """
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
