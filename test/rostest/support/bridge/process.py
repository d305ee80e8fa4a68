"""The bridge as a process of a test: its output, its memory and its end."""

import os
import signal
import subprocess
import tempfile

import rosgraph

from ..ros_testing import program, wait_for
from ..stand_in import Node

PROGRAM = "link_states_bridge.py"


class Bridge(Node):
    """A bridge with arguments of its own, on any master."""

    def __init__(self, *arguments, name="/link_states_bridge", master_uri=None):
        """Start it, and wait until it listens.

        Args:
            arguments: Parameters and names, as on a command line.
            name: Full name of the node.
            master_uri: Address of the master; None for that of the environment.
        """
        namespace, _, base = name.rpartition("/")
        namespace = namespace or "/"
        self.name = name
        self._master = rosgraph.Master("/test", master_uri)
        self._output = tempfile.TemporaryFile()  # noqa: SIM115  (kept until kill)
        self.process = subprocess.Popen(
            [program(PROGRAM), f"__name:={base}", f"__ns:={namespace}", *arguments],
            env={**os.environ, "ROS_MASTER_URI": self._master.master_uri},
            stdout=self._output,
            stderr=subprocess.STDOUT,
            start_new_session=True,
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
