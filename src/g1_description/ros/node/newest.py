"""How a subscriber asks for the newest message of a topic.

rospy reads all bytes that have come, at most a buffer full, and keeps the newest
messages of those it has read. What it has not read waits in the system's buffers,
which hold several thousand joint states. With rospy's own buffer, forty-five joint
states long, a reader that is slower than the sender falls behind by seconds.
"""

BUFFER = 1 << 20
"""Bytes that are read at once."""

NEWEST = {"queue_size": 1, "buff_size": BUFFER}
"""For ``rospy.Subscriber``: of all that has come from a publisher the last one."""
