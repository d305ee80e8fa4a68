"""When a pose is worth sending again."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass


@dataclass
class PoseThrottle:
    """Let a pose pass when it moved, turned, or was last sent a while ago.

    Plain numbers: for a single pose they cost a tenth of what arrays do.
    """

    position_threshold: float
    """A pose this far from the last one sent passes, in [m]."""

    rotation_threshold: float
    """A pose turned this far from the last one sent passes, in [rad]."""

    max_interval: float
    """Any pose passes this long after the last one sent, in [s]."""

    min_interval: float = 0.0
    """No pose passes sooner than this after the last one sent, in [s]."""

    _stamp: float | None = None
    _pose: Sequence[float] | None = None

    def passes(self, stamp: float, pose: Sequence[float]) -> bool:
        """Decide on one pose, and remember it as sent if it passes.

        Args:
            stamp: Time of the pose in [s]. A stamp that is not newer than the
                last one sent never passes.
            pose: Position and unit quaternion (x, y, z, w), seven numbers.

        Returns:
            Whether to send the pose.
        """
        if self._stamp is not None and self._pose is not None:
            # A thousandth of a microsecond: stamps are whole nanoseconds.
            since = stamp - self._stamp + 1e-9
            if stamp <= self._stamp or since < self.min_interval:
                return False
            if since < self.max_interval and not self._moved(self._pose, pose):
                return False
        self._stamp, self._pose = stamp, pose
        return True

    def settles(self, stamp: float, pose: Sequence[float]) -> bool:
        """Decide on a pose that no other follows, and remember it as sent if it passes.

        Returns:
            Whether its stamp is newer than that of the last one sent.
        """
        if self._stamp is not None and stamp <= self._stamp:
            return False
        self._stamp, self._pose = stamp, pose
        return True

    def is_near(self, pose: Sequence[float]) -> bool:
        """Tell whether a pose is the last one sent, to a tenth of the thresholds."""
        return self._pose is not None and not self._moved(self._pose, pose, 0.1)

    def _moved(
        self, before: Sequence[float], pose: Sequence[float], share: float = 1.0
    ) -> bool:
        """Decide whether a pose is a share of a threshold away from another."""
        if math.dist(pose[:3], before[:3]) >= share * self.position_threshold:
            return True
        # The chord between unit quaternions; q and -q are the same rotation.
        opposite = [-part for part in before[3:]]
        chord = min(math.dist(pose[3:], before[3:]), math.dist(pose[3:], opposite))
        angle = 4.0 * math.asin(min(1.0, 0.5 * chord))
        return angle >= share * self.rotation_threshold

    def reset(self) -> None:
        """Forget what was sent: the next pose passes."""
        self._stamp = self._pose = None
