"""A bridge of the small robot, all that comes out of it, and what it is fed."""

from xmlrpc.client import ServerProxy

import rospy
from gazebo_msgs.msg import LinkStates
from rosgraph_msgs.msg import Log
from sensor_msgs.msg import JointState

from ..ros_testing import Listener, wait_for
from ..wire.raw_publisher import RawPublisher
from .arm import arm_states, shows
from .process import Bridge
from tcpros import body_of


class Watched:
    """A bridge in a namespace of its own, with a simulator's name to itself."""

    def __init__(self, namespace, *arguments, has_clock=True):
        """Start it and connect to it.

        Args:
            namespace: Full name, which no other test has.
            arguments: More parameters, as on a command line.
            has_clock: Whether it takes the time from /clock.
        """
        self.namespace = namespace
        self._inputs = {"/clock"} if has_clock else set()
        self.topic = f"{namespace}/gazebo/link_states"
        self.publisher = RawPublisher(self.topic, LinkStates, f"{namespace}/simulator")
        self.states = Listener(f"{namespace}/joint_states", JointState)
        self.log = Listener("/rosout", Log)
        self.commands = rospy.Publisher(
            f"{namespace}/joint_commands", JointState, queue_size=10_000
        )
        self.bridge = Bridge(
            f"_gazebo:={namespace}/gazebo",
            "_model_name:=arm",
            *arguments,
            name=f"{namespace}/link_states_bridge",
        )
        self.publisher.wait_for_subscriber()
        with ServerProxy(self.bridge.uri) as node:
            wait_for(lambda: self._is_connected(node), "connections to the bridge")
        first = body_of(arm_states())
        wait_for(lambda: self.send(first) or self.states.messages, "joint states")
        self.log.clear()

    def _is_connected(self, node):
        """Tell whether the bridge hears all there is, and all it says comes here."""
        rows = [row for row in node.getBusInfo("/test")[2] if row[5]]
        heard = {row[4] for row in rows if row[1] == rospy.get_name()}
        known = {row[4] for row in rows if row[2] == "i"}
        inputs = {self.commands.resolved_name, *self._inputs}
        return {"/rosout", self.states.topic} <= heard and inputs <= known

    def send(self, data, times=1):
        """Send the bytes of a message."""
        for _ in range(times):
            self.publisher.send(data)

    def show(self, message, positions):
        """Send a message once, and wait for the joint states of it."""
        self.send(body_of(message))
        return self.states.wait(
            lambda m: shows(m, positions), f"joint states {positions}"
        )

    def warnings(self):
        """Give what the bridge warned of, or worse."""
        return [
            message.msg
            for message in list(self.log.messages)
            if message.name == self.bridge.name and message.level >= Log.WARN
        ]

    def wait_for_log(self):
        """Wait for all lines until now: the last is that of a bad command."""
        self.commands.publish(JointState(name=["wing"], position=[0.0]))
        self.log.wait(
            lambda m: "wing" in m.msg and m.name == self.bridge.name, "the last line"
        )

    def close(self):
        """End it, and wait for nothing."""
        self.bridge.process.terminate()
        self.publisher.close()
        for listener in (self.states, self.log):
            listener.close()
        self.commands.unregister()
