"""Messages that are serialised already: rospy asks a message for its bytes."""

from __future__ import annotations

from gazebo_msgs.msg import LinkStates, ModelStates, WorldState


class PreparedLinkStates(LinkStates):
    """A LinkStates message whose bytes are ready."""

    data = b""

    def serialize(self, buff):
        """Write the prepared bytes, as rospy asks of a message."""
        buff.write(self.data)


class PreparedModelStates(ModelStates):
    """A ModelStates message whose bytes are ready."""

    data = b""

    def serialize(self, buff):
        """Write the prepared bytes, as rospy asks of a message."""
        buff.write(self.data)


class PreparedWorldState(WorldState):
    """A WorldState message whose bytes after the header are ready."""

    _has_header = False  # rospy would put its own count and time into it
    data = b""

    def serialize(self, buff):
        """Write header and prepared bytes, as rospy asks of a message."""
        self.header.serialize(buff)
        buff.write(self.data)
