"""The stand-in on a host, the bridge on another, people on a third, one to spare."""

import os
import threading
from pathlib import Path

from ..ros_testing import REPOSITORY, program, wait_for
from .page import RECORD as PAGE_RECORD
from .planner import RECORD
from machines import Machines

HERE = Path(__file__).resolve().parent
STAND_IN = (
    *("__name:=gazebo", "_robot_description:=robot_description", "_on_floor:=true"),
    *("_initial/time_step:=0.01", "_initial/max_update_rate:=100"),
)
JOINT = "left_elbow_joint"
COMMANDS = 20
"""Commands per second."""


class Told:
    """What a program writes: records, read as they come."""

    def __init__(self, process, record):
        self.records = []
        self.process, self._record = process, record
        threading.Thread(target=self._read, daemon=True).start()

    def _read(self):
        while True:
            data = self.process.stdout.read(self._record.size)
            if len(data) < self._record.size:
                return
            self.records.append(self._record.unpack(data))

    def since(self, time):
        """Give the records since a time on the monotonic clock."""
        return [record for record in [*self.records] if record[0] >= time]


class Lab(Machines):
    """The hosts, and what runs on them; nothing does at first."""

    def __init__(self):
        """Make the hosts.

        Raises:
            HostsError: If that is not possible here.
        """
        super().__init__("one", "two", "three", "four")
        self.one, self.two, self.three, self.four = self.network.hosts

    def start_stand_in(self):
        """Start master and stand-in on the first host."""
        self.start_master(REPOSITORY / "urdf" / "g1_29dof.urdf")
        self.start(self.one, "gazebo", [program("gazebo_stand_in.py"), *STAND_IN])

    def start_bridge(self, offset=0.0):
        """Start the bridge, with a clock that is off by so many [s]."""
        path = os.pathsep.join([str(HERE / "clock"), os.environ["PYTHONPATH"]])
        changes = {"PYTHONPATH": path, "CLOCK_OFFSET": str(offset)} if offset else {}
        self.start(self.two, "bridge", [program("link_states_bridge.py")], **changes)

    def start_planner(self, host, name, joint=JOINT, rate=COMMANDS, **changes):
        """Start a planner, or one that only listens; give what it tells."""
        words = ["/usr/bin/python3", HERE / "planner.py", name, joint, rate]
        return Told(self.start(host, name, words, True, **changes), RECORD)

    def start_page(self):
        """Start the browser view on the third host, and look at it from there."""
        self.start(self.three, "web", [program("web.py"), "_port:=8080"])
        wait_for(self._has_page, "the page")
        words = ["/usr/bin/python3", HERE / "page.py", "http://127.0.0.1:8080"]
        return Told(self.start(self.three, "page", words, True), PAGE_RECORD)

    def _has_page(self):
        """Tell whether the browser view can be looked at."""
        assert self.programs["web"].poll() is None, self.output("web")
        return "http://" in self.output("web")
