"""TFMessage bytes, of which only the wanted edges are read.

robot_state_publisher sends an edge per joint, hundreds of times a second; who needs
none of them should not make objects of all.
"""

from __future__ import annotations

import struct
from collections.abc import Collection

from g1_description.core.errors import WireFormatError

_COUNT = struct.Struct("<I")
_STAMP = struct.Struct("<II")
_POSE = struct.Struct("<7d")
_BEFORE_STAMP = 4
"""Bytes of the count in the header."""

Edge = tuple
"""Stamp in [ns], parent, child, and the child's pose in the parent, seven numbers."""


def read_edges(data: bytes, children: Collection[bytes] | None = None) -> list[Edge]:
    """Read edges from a serialised tf2_msgs/TFMessage.

    Args:
        data: The message.
        children: Names of the child frames to read the edges of; None: all.

    Raises:
        WireFormatError: If it is too short, or a name is not UTF-8.
    """
    found = []
    try:
        (count,) = _COUNT.unpack_from(data)
        place = _COUNT.size
        for _ in range(count):
            stamp_at = place + _BEFORE_STAMP
            parent_at = stamp_at + _STAMP.size + _COUNT.size
            child_at = parent_at + _COUNT.unpack_from(data, parent_at - 4)[0] + 4
            place = child_at + _COUNT.unpack_from(data, child_at - 4)[0]
            child = data[child_at:place]
            if children is None or child in children:
                seconds, nanoseconds = _STAMP.unpack_from(data, stamp_at)
                stamp = seconds * 1_000_000_000 + nanoseconds
                parent = data[parent_at : child_at - 4].decode()
                pose = _POSE.unpack_from(data, place)
                found.append((stamp, parent, child.decode(), pose))
            place += _POSE.size
    except (struct.error, UnicodeDecodeError) as error:
        raise WireFormatError(f"TF has a message that is none: {error}.") from error
    return found
