"""Start a master and nodes of our own, and see what they use."""

import ctypes
import os
import signal
import socket
import subprocess
import tempfile
import time
from http.client import HTTPException
from pathlib import Path
from xmlrpc.client import Error, ServerProxy

import rosgraph
import rosnode

from processes import end_processes, marked_environment, new_mark

TIMEOUT = 60.0  # [s]
PAUSE = 0.02  # [s] between two looks at a condition
OWN_MODEL = Path(__file__).resolve().parents[2] / "urdf" / "g1_29dof.urdf"


class MeasurementError(Exception):
    """Something can't be measured; the text says why."""


# A node that ends while it is asked something breaks the connection it is asked on.
FAILURES = (MeasurementError, OSError, Error, HTTPException, rosgraph.MasterException)


def wait_for(condition, what, timeout=TIMEOUT):
    """Wait until a condition gives something true; give that back.

    Raises:
        MeasurementError: If it does not in time.
    """
    end = time.monotonic() + timeout
    while True:
        result = condition()
        if result:
            return result
        if time.monotonic() > end:
            break
        time.sleep(PAUSE)
    raise MeasurementError(f"waited {timeout:.0f} s in vain for {what}")


def free_port():
    """Find a port that nobody listens on."""
    with socket.socket() as listener:
        listener.bind(("localhost", 0))
        return listener.getsockname()[1]


class Process:
    """What a process uses; it may be anyone's."""

    def __init__(self, pid):
        """Find its clock of processor time, which all its threads share."""
        self.pid = pid
        clock = ctypes.c_int()
        if ctypes.CDLL(None).clock_getcpuclockid(pid, ctypes.byref(clock)):
            raise MeasurementError(f"process {pid} is gone")
        self._clock = clock.value

    def cpu_seconds(self):
        """Read how long it has used a core in [s], to the nanosecond."""
        return time.clock_gettime(self._clock)

    def meter(self):
        """Begin to measure; what comes back gives processor and wall time in [s]."""
        cpu, wall = self.cpu_seconds(), time.monotonic()
        return lambda: (self.cpu_seconds() - cpu, time.monotonic() - wall)

    def memory(self, field="VmRSS"):
        """Read its memory in [MB]: VmRSS is the present one, VmHWM the peak."""
        status = Path(f"/proc/{self.pid}/status").read_text(encoding="utf-8")
        (line,) = (line for line in status.splitlines() if line.startswith(field))
        return int(line.split()[1]) * 1024 / 1e6


class Program(Process):
    """A program that was started, and what it printed."""

    def __init__(self, command, environment):
        """Start it in a session of its own."""
        self._output = tempfile.TemporaryFile()  # noqa: SIM115  (kept until its end)
        self._process = subprocess.Popen(
            [str(word) for word in command],
            env=environment,
            start_new_session=True,
            stdin=subprocess.DEVNULL,
            stdout=self._output,
            stderr=subprocess.STDOUT,
        )
        super().__init__(self._process.pid)

    def output(self):
        """Give all it has printed."""
        self._output.seek(0)
        return self._output.read().decode("utf-8", "replace")

    def check(self):
        """Make sure that it still runs.

        Raises:
            MeasurementError: If it has ended, with what it printed last.
        """
        if self._process.poll() is not None:
            lines = self.output().strip().splitlines()[-3:]
            raise MeasurementError(f"a program ended: {' | '.join(lines)}")
        return True

    def has_ended(self):
        """Tell whether it has ended."""
        return self._process.poll() is not None

    def __enter__(self):
        """Use it in a with statement, which ends it."""
        return self

    def __exit__(self, *_):
        """Interrupt it as Ctrl-C would, and wait for its end."""
        self._process.send_signal(signal.SIGINT)
        try:
            self.wait(TIMEOUT)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self.wait()

    def wait(self, timeout=None):
        """Wait until it has ended."""
        self._process.wait(timeout)


class Graph:
    """A ROS master of our own; all that runs in it ends with it."""

    def __init__(self):
        """Start it, and wait until its log is there."""
        self._folder = tempfile.TemporaryDirectory(prefix="g1_benchmark_")
        self._mark = new_mark()
        self._programs = []
        self.port = free_port()
        for name in ("DISPLAY", "ROS_IP"):
            os.environ.pop(name, None)
        os.environ.update(
            ROS_HOSTNAME="localhost",
            ROS_HOME=self._folder.name,
            ROS_LOG_DIR=f"{self._folder.name}/log",
            ROS_MASTER_URI=f"http://localhost:{self.port}",
        )
        self.master = rosgraph.Master("/benchmark")

    def __enter__(self):
        """Start the master."""
        try:
            core = self.start(["roscore", "-p", self.port])
            wait_for(lambda: core.check() and self.finds("/rosout"), "roscore")
        except BaseException:
            self.__exit__()
            raise
        return self

    def __exit__(self, *_):
        """End whatever was started."""
        end_processes(self._mark)
        for program in self._programs:
            program.wait()
        self._folder.cleanup()

    @property
    def folder(self):
        """What its programs have for ROS_HOME."""
        return self._folder.name

    @property
    def mark(self):
        """Of its processes."""
        return self._mark

    def start(self, command):
        """Start a program; give the ``Program``."""
        self._programs.append(Program(command, marked_environment(self._mark)))
        return self._programs[-1]

    def launch(self, model, *arguments):
        """Launch the display without RViz; give the ``Program``."""
        return self._launch((), model, "rviz:=false", *arguments)

    def launch_rviz(self, model, *arguments):
        """Launch the display with RViz on a screen that nobody sees."""
        screen = ("xvfb-run", "-a", "-s", "-screen 0 1200x900x24")
        folder = self._folder.name
        # RViz leaves its settings at home, xvfb-run a folder among temporary files.
        settings = (f"HOME={folder}", f"TMPDIR={folder}", "LIBGL_ALWAYS_SOFTWARE=1")
        before = ("env", *settings, *screen)
        return self._launch(before, model, "rviz:=true", *arguments)

    def _launch(self, before, model, *arguments):
        """Launch the display; ``before`` are words before the command."""
        command = ["roslaunch", "-p", self.port, "g1_description", "display.launch"]
        return self.start([*before, *command, f"model:={model}", *arguments])

    def finds(self, name):
        """Give the address of a node, None while it is not there."""
        try:
            return rosnode.get_api_uri(self.master, name, skip_cache=True)
        except (OSError, rosnode.ROSNodeException, rosnode.ROSNodeIOException):
            return None

    def output(self):
        """Give what its programs printed."""
        return "\n".join(program.output() for program in self._programs)

    def node(self, name, timeout=TIMEOUT):
        """Give the ``Process`` of a node, once it is there."""
        uri = wait_for(lambda: self.finds(name), f"the node {name}", timeout)
        return Process(ServerProxy(uri).getPid("/benchmark")[2])
