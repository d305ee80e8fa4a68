"""Options of a subscriber that wants the newest message of a topic."""

from __future__ import annotations

BUFFER = 1 << 20
"""Bytes read from a socket at once.

rospy reads at most a buffer full and keeps the newest messages of those it has read;
what it has not read waits in the system's buffers, which hold several thousand joint
states. With rospy's own buffer, of forty-five joint states, a reader that is slower
than the sender falls behind by seconds.
"""

NEWEST = {"queue_size": 1, "buff_size": BUFFER}
"""Arguments of ``rospy.Subscriber`` to get only the last message of each publisher."""
