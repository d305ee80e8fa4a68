"""ROS on several hosts, which are network namespaces of this machine: see hosts.py."""

import os
import subprocess
import tempfile
import time
from pathlib import Path

from hosts import HostsError, Network

PORT = 11311
"""Of the master: on its host nobody else listens."""
MASTER_TIMEOUT = 300.0
"""Longest wait for the master in [s]."""


class Machines:
    """Hosts that share a master, which is on the first one."""

    def __init__(self, *names):
        """Make the hosts.

        Args:
            names: Of the hosts. All can look up the first one, and no other.

        Raises:
            HostsError: If that is not possible here.
        """
        self._folder = tempfile.TemporaryDirectory(prefix="g1_machines_")
        self.programs = {}
        """The newest program of each name."""
        self._started = []
        self.network = Network()
        self.hosts = {}
        """The hosts by name."""
        for name in names:
            known = [self.hosts[names[0]]] if self.hosts else []
            self.hosts[name] = self.network.add(name, known)
        self.first = self.hosts[names[0]]

    def close(self):
        """End all."""
        self.network.close()
        for process in self._started:
            process.wait()
            if process.stdout:
                process.stdout.close()
        self._folder.cleanup()

    def environment(self, host, **changes):
        """Give the environment of a host: its address, and the master's.

        Args:
            host: The host.
            changes: Of the environment; None takes one away.
        """
        wanted = {
            **os.environ,
            "ROS_MASTER_URI": f"http://{self.first.address}:{PORT}",
            "ROS_IP": host.address,
            "ROS_HOSTNAME": None,
            "ROS_LOG_DIR": f"{self._folder.name}/{host.name}",
            **changes,
        }
        return {name: value for name, value in wanted.items() if value is not None}

    def start(self, host, name, words, told=False, **changes):
        """Start a program on a host.

        Args:
            host: The host.
            name: Its name here.
            words: Its command.
            told: Whether its standard output is a pipe, rather than kept.
            changes: Of the environment.

        Returns:
            The Popen.
        """
        with open(self._file(name), "wb") as output:
            self.programs[name] = host.start(
                words,
                env=self.environment(host, **changes),
                stdout=subprocess.PIPE if told else output,
                stderr=output,
            )
        self._started.append(self.programs[name])
        return self.programs[name]

    def output(self, name):
        """Give what a program has printed."""
        return self._file(name).read_text(encoding="utf-8", errors="replace")

    def _file(self, name):
        """Name the file of a program's output."""
        return Path(self._folder.name, f"{name}.txt")

    def run(self, words, host=None):
        """Run a command on a host, by default the first; tell if it ended well."""
        host = host or self.first
        done = subprocess.run(
            host.command(*(str(word) for word in words)),
            env=self.environment(host),
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        return done.returncode == 0

    def start_master(self, urdf):
        """Start the master, with the parameters that a launch file would set.

        Raises:
            HostsError: If it does not answer.
        """
        self.start(self.first, "master", ["rosmaster", "--core", "-p", PORT])
        end = time.monotonic() + MASTER_TIMEOUT
        while not self.run(["rosparam", "set", "-t", urdf, "robot_description"]):
            if time.monotonic() > end:
                raise HostsError(f"no master: {self.output('master')}")
        self.run(["rosparam", "set", "/use_sim_time", "true"])
