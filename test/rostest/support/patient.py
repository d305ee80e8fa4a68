"""The nodes that the doctor looks at, as processes of a test, and a walk along them."""

from __future__ import annotations

import os
import signal
import subprocess
from contextlib import ExitStack

import rosgraph
import roslib.packages

from g1_description.cli.doctor import CHECK_NAMES, FAILED, OK, run_checks

from .ros_testing import DEADLINE, program, wait_slowly


def publishers(topic):
    """List the nodes that publish a topic, or serve a service, of a full name."""
    state = rosgraph.Master("/test").getSystemState()
    return [
        n for i in (0, 2) for name, nodes in state[i] if name == topic for n in nodes
    ]


class Started:
    """A node in a process of its own."""

    def __init__(self, name, topic, *command, **environment):
        """Start it, and wait until it is ready.

        Args:
            name: Its full name.
            topic: What it publishes, or serves, last of all.
            command: The program, and its arguments.
            environment: More variables; those that are None are left out.
        """
        variables = {**os.environ, **environment}
        self.process = subprocess.Popen(
            [*command, f"__name:={name[1:]}"],
            env={k: value for k, value in variables.items() if value is not None},
            start_new_session=True,
        )
        self.name, self.topic = name, topic
        wait_slowly(lambda: name in publishers(topic), f"{name} with {topic}")

    def end(self, number=signal.SIGINT):
        """End it, and wait until the master knows, if that is told."""
        if self.process.poll() is None:
            os.killpg(self.process.pid, number)
        self.process.wait(DEADLINE)
        if number != signal.SIGKILL:
            wait_slowly(lambda: self.name not in publishers(self.topic), "its end")


def start_bridge(*arguments):
    """Start the bridge."""
    executable = program("link_states_bridge.py")
    return Started("/link_states_bridge", "/tf_joint_states", executable, *arguments)


def start_simulator(*arguments):
    """Start the stand-in."""
    topic = "/gazebo/set_parameters"  # its last service
    return Started("/gazebo", topic, program("gazebo_stand_in.py"), *arguments)


def start_state_publisher(*arguments):
    """Start robot_state_publisher as bridge.launch does."""
    name = "robot_state_publisher"
    remapped = "joint_states:=tf_joint_states", "_ignore_timestamp:=true"
    command = roslib.packages.find_node(name, name)[0]
    started = Started(f"/{name}", "/tf", command, *remapped, *arguments)
    wait_slowly(  # which it does last of all
        lambda: (
            ["/tf_joint_states", [f"/{name}"]]
            in rosgraph.Master("/test").getSystemState()[1]
        ),
        f"/{name} to subscribe",
    )
    return started


PARTS = {
    "simulator": start_simulator,
    "bridge": start_bridge,
    "state_publisher": start_state_publisher,
}


class Patient:
    """A whole chain, without a picture."""

    def __init__(self):
        """Start it."""
        with ExitStack() as stack:
            self._parts = {}
            stack.callback(self._end)
            self.heal()
            self._stack = stack.pop_all()

    def start(self, part, *arguments):
        """Start a part."""
        self._parts[part] = PARTS[part](*arguments)

    def stop(self, part):
        """End a part."""
        self._parts.pop(part).end()

    def wait_for_end(self, part):
        """Wait until a part that something else ends has ended."""
        self._parts.pop(part).process.wait(DEADLINE)

    def heal(self):
        """Start what is missing, and wait until all is whole."""
        missing = [part for part in PARTS if part not in self._parts]
        for part in missing:
            self.start(part)
        if missing:
            wait_slowly(lambda: walk("tf") is None, "a whole chain")

    def close(self):
        """End all."""
        self._stack.close()

    def _end(self):
        """End all parts."""
        for part in list(self._parts):
            self.stop(part)


def walk(until="diagnostics"):
    """Walk from the master to a link; check that one at most is broken.

    Returns:
        The fault, None if all is whole.
    """
    names = CHECK_NAMES[CHECK_NAMES.index("master") : CHECK_NAMES.index(until) + 1]
    found = list(run_checks("", names))
    broken = [one for one in found if one.state == FAILED]
    assert len(broken) <= 1 and [one.name for one in found] == names
    if broken:
        before = found[: found.index(broken[0])]
        assert all(one.state == OK for one in before)
    return broken[0].fault if broken else None
