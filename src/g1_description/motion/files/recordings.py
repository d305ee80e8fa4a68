"""ROS' recordings of any container: their channels, and their messages.

The message definitions in a recording are not used: messages are read with own
definitions, so nothing in a file becomes code.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import islice
from typing import TYPE_CHECKING, Any

from g1_description.errors import MotionError, cause
from g1_description.motion.files.arrays import MAX_SIZE
from g1_description.motion.motion import Motion

if TYPE_CHECKING:
    from rosbags.typesys.store import Typestore

MAX_MESSAGES = 250_000
"""Most messages on the topics that are read."""

MIN_STAMP = 1
"""The first stamp of a written motion, in [ns]: zero means no stamp in ROS."""

SPARE = 0.98
"""Fraction of the readable size that is written: a file also has other messages."""

MAX_CHUNK = 100_000_000
"""Largest size of a decompressed chunk in bytes: ROS writes 1 MB."""

_STAMPS = {
    "ros1": "uint32 seq\nuint32 secs\nuint32 nsecs\n",
    "cdr": "int32 secs\nuint32 nsecs\n",
}
"""Beginnings of a std_msgs/Header, by how messages are encoded in ROS 1 and 2."""

_DURATION = "int32 secs\nint32 nsecs\n"

_DEFINITIONS = {
    "Pose": "float64[7] numbers",
    "Twist": "float64[6] numbers",
    "Edge": "{stamp}string parent\nstring child\nfloat64[7] pose",
    "JointPoint": f"float64[] positions\nfloat64[] velocities\n"
    f"float64[] accelerations\nfloat64[] efforts\n{_DURATION}",
    "BasePoint": "Pose[] poses\nTwist[] velocities\nTwist[] accelerations\n"
    f"{_DURATION}",
    "JointTrajectory": "{stamp}string frame\nstring[] names\nJointPoint[] points",
    "BaseTrajectory": "{stamp}string frame\nstring[] names\nBasePoint[] points",
    "RobotTrajectory": "JointTrajectory joints\nBaseTrajectory base",
    "JointState": "{stamp}string frame\nstring[] names\nfloat64[] positions\n"
    "float64[] velocities\nfloat64[] efforts",
    "TFMessage": "Edge[] edges",
    "Odometry": "Edge edge\nfloat64[78] covariances_and_twist",
    "PoseStamped": "{stamp}string frame\nfloat64[7] pose",
    "Time": "uint32 secs\nuint32 nsecs",
    "ReceivedCommands": "Time first\nTime last\nuint32 count\nstring sender\n"
    "string topic\nstring content\nfloat64[] times\nstring[] joint_names\n"
    "float32[] positions",
}
"""Definitions that match the bytes of ROS' messages with few fields: reading ten
minutes of TF takes 2 s instead of 13 s."""


@dataclass(frozen=True, eq=False)
class Channel:
    """Messages of one publisher, or of several, on one topic."""

    topic: str
    type: str
    """Name of the type, as in the file."""

    kind: str
    """Which of ``_DEFINITIONS`` reads them; empty: none."""

    encoding: str
    """How its messages are encoded, as in the file."""

    count: int
    """Number of messages."""

    sender: str | None = None
    """Name of the publisher; None: the file does not say it."""


@dataclass(frozen=True)
class Recording:
    """An open file."""

    channels: Sequence[Channel]

    messages: Callable[[Collection[Channel]], Iterator[tuple[Channel, int, bytes]]]
    """Given channels, yields their messages in the order of the file: times of
    recording in [ns], and bytes."""


def unpacked(decompress: Callable[[bytes, int], bytes], data: bytes) -> bytes:
    """Decompress a chunk.

    Args:
        decompress: Given bytes, returns at most a number of decompressed ones.
        data: The chunk.

    Raises:
        MotionError: If it is too large.
    """
    found = decompress(data, MAX_CHUNK)
    if len(found) == MAX_CHUNK:
        raise MotionError(f"A chunk of the bag has more than {MAX_CHUNK // 10**6} MB.")
    return found


@lru_cache(maxsize=None)
def _typestore(encoding: str) -> Typestore:
    """Compile ``_DEFINITIONS``."""
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    store = get_typestore(Stores.EMPTY)
    for name, definition in _DEFINITIONS.items():
        text = definition.format(stamp=_STAMPS[encoding])
        store.register(get_types_from_msg(text, f"g1/msg/{name}"))
    return store


def _decoded(channel: Channel, data: bytes) -> Any:
    """Decode a message."""
    store = _typestore(channel.encoding)
    is_ros1 = channel.encoding == "ros1"
    decode = store.deserialize_ros1 if is_ros1 else store.deserialize_cdr
    return decode(data, f"g1/msg/{channel.kind}")


def topics_of(bag: Recording, *kinds: str) -> dict[str, list[Channel]]:
    """Find the topics with messages of some types."""
    found: dict[str, list[Channel]] = {}
    for channel in bag.channels:
        if channel.count and channel.kind in kinds:
            own = found.setdefault(channel.topic, [])
            if not own or own[0].kind == channel.kind:
                own.append(channel)
    return found


def messages_of(
    bag: Recording, channels: Collection[Channel]
) -> Iterator[tuple[int, Any]]:
    """Yield times of recording in [ns], and messages."""
    if not channels:
        return
    if sum(channel.count for channel in channels) > MAX_MESSAGES:
        raise MotionError(
            f"The bag has more than {MAX_MESSAGES} messages on the relevant topics. "
            "Reduce it with 'rosbag filter' or 'mcap filter'."
        )
    # A file may have more than it says.
    for channel, time, data in islice(bag.messages(channels), MAX_MESSAGES):
        try:
            yield time, _decoded(channel, data)
        except Exception as error:  # any error of struct or numpy on damaged bytes
            problem = f"a message is damaged: {cause(error)}"
            raise MotionError(f"On {channel.topic} {problem}.") from error


def stamps_of(motion: Motion, begin: int, most: int) -> list[int]:
    """Return the stamps of a motion's samples, in [ns].

    Args:
        motion: The motion.
        begin: Stamp of the first sample, in [ns].
        most: The largest stamp, in [ns].

    Raises:
        MotionError: If a stamp is larger.
    """
    times = (motion.times - motion.times[0]).tolist()
    stamps = [begin + round(time * 1e9) for time in times]
    if stamps[-1] > most:
        raise MotionError(f"The stamp {stamps[-1] / 1e9:g} s is too large for a bag.")
    return stamps


def most_samples(joints: Sequence[str], has_tf: bool) -> int:
    """Return the largest number of samples of a recording that can be read again.

    Args:
        joints: Names of the motion's joints.
        has_tf: Whether each sample also has a message of TF.
    """
    counts = MAX_MESSAGES / (2 if has_tf else 1), MAX_SIZE / (len(joints) or 1)
    return int(SPARE * min(counts))
