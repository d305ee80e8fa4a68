"""The live node, started and ended by a test: its output, memory and end."""

import subprocess
import tempfile
from pathlib import Path

from .ros_testing import DEADLINE, process_of, program, wait_for
from .wire.services import Services

TROUBLE = (b"Traceback", b"Segmentation")


class Node:
    """The stand-in as a process of this test, with the parameters of the .test file."""

    def __init__(self):
        """Start it, and wait for the service that comes last."""
        self._output = tempfile.TemporaryFile()  # noqa: SIM115  (kept until kill)
        self.process = subprocess.Popen(
            [program("gazebo_stand_in.py"), "__name:=gazebo"],
            stdout=self._output,
            stderr=subprocess.STDOUT,
            start_new_session=True,
        )
        self.pid = self.process.pid
        wait_for(self._is_up, "the simulator")
        self.services = Services()

    def _is_up(self):
        assert self.process.poll() is None, self.output()
        return (
            process_of("/gazebo") == self.pid and "set_parameters" in Services().names
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

    def memory(self):
        """Give the resident memory in [bytes]."""
        status = Path(f"/proc/{self.pid}/status").read_text(encoding="utf-8")
        (line,) = (line for line in status.splitlines() if line.startswith("VmRSS"))
        return int(line.split()[1]) * 1024

    def threads(self):
        """Count its threads."""
        return len(list(Path(f"/proc/{self.pid}/task").iterdir()))

    def seconds_of_processor(self):
        """Give the processor time it has used in [s]."""
        fields = Path(f"/proc/{self.pid}/stat").read_text().rsplit(")", 1)[1].split()
        return (int(fields[11]) + int(fields[12])) / 100.0

    def cost(self, seconds=0.5):
        """Measure the processor time per simulated second."""
        begin, used = self.time(), self.seconds_of_processor()
        wait_for(lambda: self.time() > begin + seconds, "simulated time")
        return (self.seconds_of_processor() - used) / (self.time() - begin)

    def time(self):
        """Tell the simulated time in [s]."""
        return self.services.call("get_world_properties").sim_time

    def end(self, signal_number):
        """Send a signal, and wait for the end."""
        self.process.send_signal(signal_number)
        self.process.wait(DEADLINE)

    def kill(self):
        """Make sure that it is gone."""
        if self.is_alive():
            self.process.kill()
        self.process.wait(DEADLINE)
        self._output.close()
