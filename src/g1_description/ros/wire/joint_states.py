"""JointState messages as bytes, without lists of Python numbers."""

from __future__ import annotations

import struct
from collections.abc import Sequence

import numpy as np
from sensor_msgs.msg import JointState

_COUNT = struct.Struct("<I")
_STAMP = struct.Struct("<III")


class PreparedJointState(JointState):
    """A JointState message whose bytes are ready."""

    _has_header = False  # rospy would put its own count and time into it
    data = b""

    def serialize(self, buff):
        """Write the prepared bytes, as rospy asks of a message."""
        buff.write(self.data)


class JointStateEncoder:
    """Write JointState messages; the names are only written when they change.

    Effort is left empty because it is not known.
    """

    def __init__(self) -> None:
        """Begin without names."""
        self._names: Sequence[str] | None = None
        self._seq = 0

    def encode(
        self,
        stamp: int,
        names: Sequence[str],
        position: np.ndarray,
        velocity: np.ndarray,
    ) -> PreparedJointState:
        """Write one message.

        Args:
            stamp: Time of the state in [ns].
            names: Joint names. The same object as last time costs nothing.
            position: In [rad] or [m], shape (n_joints,).
            velocity: In [rad/s] or [m/s], shape (n_joints,).
        """
        if names is not self._names:
            encoded = [name.encode("utf-8") for name in names]
            self._count = _COUNT.pack(len(encoded))
            strings = b"".join(_COUNT.pack(len(name)) + name for name in encoded)
            # Between stamp and names stands the empty frame_id.
            self._head = _COUNT.pack(0) + self._count + strings + self._count
            self._names = names
        self._seq += 1
        message = PreparedJointState()
        message.data = b"".join(
            (
                _STAMP.pack(self._seq, *divmod(stamp, 1_000_000_000)),
                self._head,
                np.asarray(position, dtype="<f8").tobytes(),
                self._count,
                np.asarray(velocity, dtype="<f8").tobytes(),
                _COUNT.pack(0),
            )
        )
        return message
