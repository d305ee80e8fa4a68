"""A display with the browser view, and browsers; for the part ``browser``."""

import json
import socket
import sys
import time
from pathlib import Path

import numpy as np
from sensor_msgs.msg import JointState

from g1_description.robot.load import absolute_urdf
from g1_description.robot.urdf import parse_urdf

from .motion import revolute, swing
from .nodes import MeasurementError, free_port, wait_for
from tcpros import body_of, packed

HERE = Path(__file__).resolve().parent
NODES = {
    "view": "/web",
    "simulator": "/gazebo",
    "bridge": "/link_states_bridge",
}
ARM = "left_shoulder_pitch"
STEP = 0.5  # [rad] from one command for the arm to the next, at least
RATE = 100.0  # [Hz] of a robot that moves


class Display:
    """A display with the view, and hands for it."""

    def __init__(self, graph, bench, peer):
        """Launch it, and wait until all are there."""
        port = free_port()
        self.graph, self.peer = graph, peer
        graph.launch(bench.model, "web:=true", f"port:={port}")
        self.address = f"http://127.0.0.1:{port}/"
        robot = parse_urdf(absolute_urdf(str(bench.model)))
        self.joints = revolute(robot)
        self.names = [joint.name for joint in self.joints]
        (self.arm,) = (j for j in self.joints if j.name == f"{ARM}_joint")
        self.came = []
        self.processes = {what: graph.node(name) for what, name in NODES.items()}
        self._commands = peer.advertise("/joint_commands", JointState)
        peer.subscribe("/joint_states", JointState, self._take)
        peer.wait(lambda: self._commands.callers and self.came, "the bridge", 60.0)
        wait_for(lambda: _is_open(port), "the page")

    def _take(self, now, body):
        """Keep joint states."""
        self.came.append((now, body))

    def send(self, values):
        """Command joints by name, in [rad]; give the time just before."""
        message = JointState(name=[*values], position=[*values.values()])
        data = packed(body_of(message))
        begin = time.monotonic()
        self._commands.send(data)
        return begin

    def arm_commands(self, count, seed):
        """Make functions that move the arm elsewhere, each with its value in [rad]."""
        random, value = np.random.default_rng(seed), np.inf
        lower, upper = max(self.arm.lower, -1.5), min(self.arm.upper, 1.5)
        for _ in range(count):
            drawn = random.uniform(lower, upper, 100)
            value = float(drawn[np.abs(drawn - value) > STEP][0])
            self.peer.serve(time.monotonic() + random.uniform(0.0, 0.1))
            self.came.clear()
            yield lambda v=value: self.send({self.arm.name: v}), value

    def move(self, seconds):
        """Move all joints for a while; give samples, and when each was sent."""
        n = round(seconds * RATE)
        # From the middle of a motion that begins and ends at rest.
        positions = swing(self.joints, 3.0 * seconds, RATE)[n : 2 * n]
        sent, begin = [], time.monotonic()
        for number, row in enumerate(positions.tolist()):
            self.peer.serve(begin + number / RATE)
            sent.append(self.send(dict(zip(self.names, row))))
        return positions, np.array(sent)

    def watch(self, count):
        """Start browsers; give the ``Watchers``."""
        return Watchers(self, count)


def _is_open(port):
    """Tell whether somebody listens."""
    with socket.socket() as caller:
        return not caller.connect_ex(("127.0.0.1", port))


class Watchers:
    """So many browsers that are a process."""

    def __init__(self, display, count):
        """Open pages, and wait until they are whole."""
        link = display.arm.child
        command = (sys.executable, HERE / "watchers.py", display.address, count, link)
        self.count = count
        self._program = display.graph.start(command) if count else None
        if count:
            wait_for(lambda: self._program.check() and self._said(), "open pages")

    def _said(self):
        """List what it has printed, but a line that is not whole."""
        lines = self._program.output().split("\n")[:-1]
        return [json.loads(line) for line in lines]

    def between(self, begin, end):
        """Give bytes and moves per second and browser in some time."""
        self._program.check()
        told = [line for line in self._said() if begin <= line[0] <= end]
        if len(told) < 2:
            raise MeasurementError("the browsers said nothing")
        first, last = told[0], told[-1]
        passed = (last[0] - first[0]) * self.count
        return (last[1] - first[1]) / passed, (last[2] - first[2]) / passed

    def __enter__(self):
        """Give itself."""
        return self

    def __exit__(self, *_):
        """Close the pages."""
        if self._program is not None:
            self._program.__exit__()
