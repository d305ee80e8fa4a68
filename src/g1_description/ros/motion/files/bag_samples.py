"""The joints of a bag's messages, as columns."""

from __future__ import annotations

import numpy as np

from g1_description.core.errors import MotionError
from g1_description.core.motion.formats.arrays import MAX_SIZE
from g1_description.ros.wire.motions import JointSample

from .bag_records import Topic


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
