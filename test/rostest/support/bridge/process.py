"""The bridge as a process of a test: its output, its memory and its end."""

import os
import signal
import tempfile

import rosgraph

from ..programs import Program
from ..ros_testing import wait_for
from ..stand_in import Node


class Bridge(Node):
    """A bridge with arguments of its own, on any master."""

    def __init__(self, *arguments, name="/link_states_bridge"):
        """Start it, and wait until it listens.

        Args:
            arguments: Parameters and names, as on a command line.
            name: Full name of the node.
        """
        namespace, _, base = name.rpartition("/")
        namespace = namespace or "/"
        self.name = name
        self._master = rosgraph.Master("/test")
        self._output = tempfile.TemporaryFile()  # noqa: SIM115  (kept until kill)
        self.process = Program(
            *("link_states_bridge.py", f"__name:={base}", f"__ns:={namespace}"),
            *arguments,
            output=self._output.fileno(),
        )
        self.pid = self.process.pid
        wait_for(self._is_up, f"{name} to listen")

    def _is_up(self):
        """Tell whether it has subscribed to what it subscribes to last."""
        assert self.process.poll() is None, self.output()
        _, subscribers, _ = self._master.getSystemState()
        return any(
            topic.endswith("/link_states") and self.name in nodes
            for topic, nodes in subscribers
        )

    def stop(self):
        """Let it stand still."""
        os.kill(self.pid, signal.SIGSTOP)

    def go_on(self):
        """Let it go on."""
        os.kill(self.pid, signal.SIGCONT)

    @property
    def uri(self):
        """Where its node is."""
        return self._master.lookupNode(self.name)
