"""Tells how well motors followed motions.

Publishes: ~tracking (g1_description/TrackingReport): one for each motion, latched
"""

from __future__ import annotations

import rospy

from g1_description.msg import TrackingReport
from g1_description.ros.wire.conversions import stamp_from_ns
from g1_description.sim.motion.tracking import TrackedMotion
from g1_description.sim.world import World

QUEUE_SIZE = 100
"""Reports kept for a slow subscriber: as many robots may end a motion together."""


class TrackingTopic:
    """Publishes and logs what became of each motion that motors followed."""

    def __init__(self, world: World) -> None:
        """Advertise the topic.

        Args:
            world: Whose motions are told.
        """
        self._world = world
        self._publisher = rospy.Publisher(
            "~tracking", TrackingReport, queue_size=QUEUE_SIZE, latch=True
        )

    def publish(self) -> None:
        """Publish and log what ended since the last time."""
        for tracked in self._world.motions.take_tracked():
            rospy.loginfo("%s: %s", tracked.model_name, tracked.report)
            self._publisher.publish(_message(tracked))


def _message(tracked: TrackedMotion) -> TrackingReport:
    """Write a report as a message."""
    report = tracked.report
    return TrackingReport(
        model_name=tracked.model_name,
        start=stamp_from_ns(tracked.start_ns),
        duration=report.duration,
        joint_names=list(report.joint_names),
        rms_errors=report.rms_errors.tolist(),
        largest_errors=report.largest_errors.tolist(),
        limit_shares=report.limit_shares.tolist(),
        has_fallen=report.fall_time is not None,
        fall_time=report.fall_time or 0.0,
    )
