"""The programs that run for long, and what disturbs them."""

import json
import os
import shutil
import signal
import sys
import time
from pathlib import Path
from xmlrpc.client import ServerProxy

import numpy as np
from bench.graph import FAILURES, OWN_MODEL, Graph, Process, free_port, wait_for

HERE = Path(__file__).resolve().parent
OURS = {
    "stand-in": "/gazebo",
    "bridge": "/link_states_bridge",
    "browser view": "/web",
    "checks": "/checker",
}
OTHERS = {"robot_state_publisher": "/robot_state_publisher", "RViz": "/rviz"}
FORGETFUL = ("/robot_state_publisher", "/ghost_state_publisher", "/rviz")
"""Written with roscpp, which registers with a master only once."""
RESTART = 2.0
"""Shortest time from one start of a program to the next in [s]."""
LINK = "left_knee_link"
"""Moves in the motion."""


class Relay:
    """A program that is started again whenever it has ended."""

    def __init__(self, graph, command):
        """Start it for the first time.

        Args:
            graph: Whose program it is.
            command: Its words.
        """
        self._graph, self._command = graph, command
        self.programs, self._started = [graph.start(command)], time.monotonic()

    @property
    def program(self):
        """The one that was started last."""
        return self.programs[-1]

    def keep_up(self):
        """Start it again if it has ended; not at once, as there may be no master."""
        now = time.monotonic()
        if self.program.has_ended() and now > self._started + RESTART:
            self.programs.append(self._graph.start(self._command))
            self._started = now


class World(Graph):
    """A display with a browser, a motion and a probe, and what disturbs them."""

    def __init__(self, with_rviz):
        """Prepare.

        Args:
            with_rviz: Whether to run RViz, if there is Xvfb.
        """
        super().__init__()
        self.has_rviz = bool(with_rviz and shutil.which("xvfb-run"))
        self.folder = Path(self._folder.name)
        self._processes = {}

    def __enter__(self):
        """Start the master."""
        super().__enter__()
        self._core = self._programs[0]
        return self

    def begin(self, plan):
        """Launch all; return when joint states flow and the page is open.

        Args:
            plan: A ``Plan``.
        """
        launch = self.launch_rviz if self.has_rviz else self.launch
        port = free_port()
        words = ("web:=true", f"port:={port}", "checks:=true", "respawn_gazebo:=true")
        self.display = launch(OWN_MODEL, *words)
        for name in self.names.values():
            self.node(name)
        motion = self.folder / "motion.csv"
        write_motion(motion)
        script = HERE / "browser.py"
        address = f"http://127.0.0.1:{port}/"
        wait_for(lambda: "open http" in self.display.output(), "the page")
        self.browser = Relay(self, [sys.executable, script, address, 1, LINK])
        play = ["rosrun", "g1_description", "play", motion, "--loop"]
        self.player = Relay(self, play)
        periods = plan.command_period, plan.reset_period, plan.sample_period
        self.probe = self.start([sys.executable, HERE / "probe_node.py", *periods])

    @property
    def names(self):
        """Names of the nodes that are watched, by what they are called here."""
        others = {k: v for k, v in OTHERS.items() if self.has_rviz or k != "RViz"}
        return {**OURS, **others}

    def find(self, what):
        """Give the ``Process`` of a node, None while it is not there."""
        process = self._processes.get(what)
        if process is None or not Path(f"/proc/{process.pid}").exists():
            self._processes.pop(what, None)
            try:
                uri = self.finds(self.names[what])
                pid = uri and ServerProxy(uri).getPid("/soak")[2]
                if not pid or not Path(f"/proc/{pid}").exists():
                    return None
                self._processes[what] = process = Process(pid)
            except FAILURES:
                return None
        return process

    def kill_simulator(self):
        """Kill it as if it had crashed; roslaunch starts another one."""
        process = self.find("stand-in")
        if process is not None:
            os.kill(process.pid, signal.SIGKILL)

    def restart_master(self):
        """Let the master die, and another one take its place.

        Parameters live in the master, so they are put into the new one.
        """
        parameters = self.master.getParam("/")
        nodes = {}
        for name in FORGETFUL:
            uri = self.finds(name)
            if uri:
                nodes[name] = uri
        self._core.__exit__()
        self._core = self.start(["roscore", "-p", self.port])
        wait_for(lambda: self.finds("/rosout"), "another master")
        for name, value in parameters.items():
            self.master.setParam(f"/{name}", value)
        for name, uri in nodes.items():
            self._register(name, uri)

    def _register(self, name, uri):
        """Register the topics of a node that does not do it itself."""
        node, master = ServerProxy(uri), ServerProxy(os.environ["ROS_MASTER_URI"])
        for topic, kind in node.getPublications("/soak")[2]:
            master.registerPublisher(name, topic, kind, uri)
        for topic, kind in node.getSubscriptions("/soak")[2]:
            addresses = master.registerSubscriber(name, topic, kind, uri)[2]
            node.publisherUpdate("/master", topic, addresses)

    def unknown(self):
        """List the nodes that the master does not know, or that have ended."""
        return [
            what
            for what, name in self.names.items()
            if not self.finds(name) or self.find(what) is None
        ]

    def printed(self):
        """Give what all programs printed, but not rospy's own logs, which nobody sees.

        rospy writes tracebacks of refused connections to them.
        """
        logs = (self.folder / "log").rglob("*-std*.log")
        texts = [program.output() for program in self._programs]
        texts += [log.read_text(errors="replace") for log in logs if log.is_file()]
        return "\n".join(texts)

    def moves(self):
        """Give how often a link moved in the browser so far, and when that was told."""
        lines = self.browser.program.output().split("\n")[:-1]
        numbers = [json.loads(line) for line in lines[-1:] if line.startswith("[")]
        return (numbers[0][0], numbers[0][2]) if numbers else (time.monotonic(), 0)


def write_motion(file):
    """Write a motion of 8 s: knees and arms go up and down, and the base with them."""
    times = np.arange(0.0, 8.0, 1.0 / 50.0)
    swing = 0.5 - 0.5 * np.cos(2.0 * np.pi * times / 4.0)
    columns = {
        "time": times,
        "base_x": 0.0 * times,
        "base_y": 0.0 * times,
        "base_z": 0.8 - 0.1 * swing,
        "base_qx": 0.0 * times,
        "base_qy": 0.0 * times,
        "base_qz": 0.0 * times,
        "base_qw": 1.0 + 0.0 * times,
    }
    for side in ("left", "right"):
        columns[f"{side}_hip_pitch_joint"] = -0.4 * swing
        columns[f"{side}_knee_joint"] = 0.8 * swing
        columns[f"{side}_ankle_pitch_joint"] = -0.4 * swing
        columns[f"{side}_shoulder_pitch_joint"] = -0.9 * swing
    header = ",".join(columns)
    rows = np.stack([*columns.values()], axis=1)
    np.savetxt(file, rows, delimiter=",", header=header, comments="", fmt="%.6f")
