"""An action server whose status does not hang on simulated time."""

from __future__ import annotations

import time

import actionlib
import rospy

STATUS_PERIOD = 0.2
"""Time between two publications of the goals' status, in [s] of wall time."""


class SteadyActionServer(actionlib.ActionServer):
    """An action server that gets along with time that stands still or goes back.

    actionlib's own publishes its status from a timer in simulated time: the timer is
    woken by every message on /clock, waits while time stands still, and ends for good
    when time goes back.
    """

    _last_status = 0.0

    def initialize(self) -> None:
        """Advertise and subscribe, without the timer."""
        super().initialize()
        if self.status_timer is not None:
            self.status_timer.shutdown()

    def keep_up(self) -> None:
        """Publish the status where it is due; to be called several times a second."""
        now = time.monotonic()
        if now - self._last_status >= STATUS_PERIOD:
            self._last_status = now
            self.publish_status()

    def reset(self) -> None:
        """Forget times that are still to come, as time went back."""
        with self.lock:
            self.last_cancel = rospy.Time()
            now = rospy.Time.now()
            for tracker in self.status_list:
                tracker.handle_destruction_time = min(
                    tracker.handle_destruction_time, now
                )
