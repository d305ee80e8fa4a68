"""The live node, started and ended by a test: its output, memory and end."""

import signal
import tempfile

import rospy

from .programs import Program
from .ros_testing import DEADLINE, process_of, wait_for
from .wire.services import Services

TROUBLE = (b"Traceback", b"Segmentation")


class Node:
    """The stand-in as a process of this test, with a robot."""

    def __init__(self, *arguments, name="gazebo"):
        """Start it, and wait for the service that comes last.

        Args:
            arguments: More parameters and names, as on a command line.
            name: Of the node.
        """
        if rospy.has_param(name):
            rospy.delete_param(name)  # what the last one left
        self._output = tempfile.TemporaryFile()  # noqa: SIM115  (kept until kill)
        self.process = Program(
            *("gazebo_stand_in.py", f"__name:={name}"),
            *("_robot_description:=robot_description", *arguments),
            output=self._output.fileno(),
        )
        self._name = name
        self.pid = self.process.pid
        wait_for(self._is_up, "the simulator")
        self.services = Services(f"/{name}")

    def _is_up(self):
        assert self.process.poll() is None, self.output()
        return (
            process_of(f"/{self._name}") == self.pid
            and "set_parameters" in Services(f"/{self._name}").names
        )

    def is_alive(self):
        return self.process.poll() is None

    def output(self):
        """Give all it has written."""
        self._output.seek(0)
        return self._output.read()

    def trouble(self):
        """Give the ends of the lines that tell of an exception."""
        lines = self.output().splitlines()
        return [line[-800:] for line in lines if any(word in line for word in TROUBLE)]

    def time(self):
        """Tell the simulated time in [s]."""
        return self.services.call("get_world_properties").sim_time

    def end(self, signal_number):
        """Send a signal, and wait for the end."""
        self.process.send_signal(signal_number)
        self.process.wait(DEADLINE)

    def close(self):
        """End it as a signal does."""
        self.end(signal.SIGTERM)
        self._output.close()

    def kill(self):
        """Make sure that it is gone."""
        if self.is_alive():
            self.process.kill()
        self.process.wait(DEADLINE)
        self._output.close()
