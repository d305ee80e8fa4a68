"""Walks the chain from the master to the picture, until a link is broken."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator, Sequence
from importlib import import_module
from typing import Any

from g1_description.cli.doctor import machine, screen, shell
from g1_description.cli.doctor.faults import (
    BROKEN,
    NOT_LOOKED_AT,
    OK,
    Fault,
    Walked,
    fault,
)
from g1_description.cli.doctor.master import ERRORS, Master, reason_of
from g1_description.cli.doctor.nodes import node_addresses
from g1_description.text import listed


class Walk:
    """What one link finds out is there for the next."""

    def __init__(self, namespace: str, names: Sequence[str]) -> None:
        """Begin with nothing known.

        Args:
            namespace: Of the robot's topics, without slashes around.
            names: The links, one after the other.
        """
        self._namespace, self._names = namespace, names
        self._master = Master(os.environ.get("ROS_MASTER_URI") or shell.DEFAULT_MASTER)
        self._is_here = True
        self._own = shell.Interpreter(machine.own_python(), {})
        self._robot: Any = None
        self.current = names[0]
        """The link that is looked at."""

    def run(self) -> Iterator[Walked]:
        """Look at the links one by one; after a broken one at none.

        Raises:
            KeyboardInterrupt: If a signal ends the walk.
        """
        try:
            yield from self._run()
        finally:
            if self._robot is not None:
                self._robot.close()

    def _run(self) -> Iterator[Walked]:
        """Look at the links one by one."""
        names = iter(self._names)
        for name in names:
            self.current = name
            found = self._look(name)
            _stop_if_shut_down()
            if isinstance(found, Fault):
                yield Walked(name, BROKEN, found.name, found)
                break
            yield Walked(name, OK, found)
        for name in names:
            yield Walked(name, NOT_LOOKED_AT)

    def _look(self, name: str) -> Fault | str:
        """Look at a link: return its fault, or a remark where it is whole."""
        own = {
            "python": self._python,
            "packages": self._packages,
            "master": self._ask_master,
            "address": self._address,
            "nodes": self._nodes,
        }
        try:
            if name in own:
                return own[name]()
            if name == "picture":
                return self._robot.viewers() or screen.picture(os.environ)
            return self._robot.look(name)
        except (*ERRORS, SystemExit) as error:
            _stop_if_shut_down()
            gone = self._ask_master()  # meanwhile
            if isinstance(gone, Fault):
                return gone
            words = f"{type(error).__name__}: {error}"
            reason = reason_of(error) if isinstance(error, OSError) else words
            return fault("unfinished", link=name, reason=reason)

    def _python(self) -> Fault | str:
        """Import what is of ROS, by this Python and the one on PATH."""
        own, first = machine.own_python(), machine.python_on_path()
        names = [*shell.OF_ROS, *shell.OF_WORKSPACE, *shell.PACKAGES]
        self._own = shell.Interpreter(own, machine.failed_imports(own, names))
        on_path = shell.Interpreter(first, self._own.failed)
        if first and not machine.is_same_python(own, first):
            failed = machine.failed_imports(first, shell.OF_ROS)
            on_path = shell.Interpreter(first, failed)
        setup = machine.setup_file()
        sourced = machine.is_sourced()
        wrong = shell.python(self._own, machine.ROS_FOLDER, setup, sourced)
        return wrong or shell.python_remark(self._own, on_path, machine.ROS_FOLDER)

    def _packages(self) -> Fault | str:
        """Judge what the nodes import."""
        needs_pybullet = "pybullet" in self._own.failed and not self._is_gazebo()
        return shell.packages(self._own, needs_pybullet) or self._own.path

    def _is_gazebo(self) -> bool:
        """Whether the real Gazebo runs, which needs no PyBullet."""
        try:
            services = self._master.graph().services
        except ERRORS:
            return False
        of_all, of_ours = "/gazebo/set_model_configuration", "/gazebo/step"
        return of_all in services and of_ours not in services

    def _ask_master(self) -> Fault | str:
        """Ask the master whether it is there."""
        uri = self._master.uri
        wrong = shell.master_uri(uri)
        if wrong:
            return wrong
        addresses = machine.addresses_of(shell.host_of(uri)[0])
        self._is_here = any(map(machine.is_own, addresses))
        try:
            self._master.ping()
        except ERRORS as error:
            return shell.master(uri, reason_of(error), self._is_here)
        return uri

    def _address(self) -> Fault | str:
        """Judge what nodes of this shell give as their address."""
        variable, value = machine.own_name(os.environ)
        addresses = {a: machine.is_own(a) for a in machine.addresses_of(value)}
        host, _ = shell.host_of(self._master.uri)
        towards = machine.address_towards(host)
        wrong = shell.own_address((variable, value), addresses, self._is_here, towards)
        return wrong or f"{variable}: {value}"

    def _nodes(self) -> Fault | str:
        """Ask all nodes; prepare to look at what needs more than the standard library.

        What that needs was looked at before.
        """
        graph = self._master.graph()
        answers = self._master.ask_nodes(graph.nodes)
        graph = graph.still(self._master.graph())  # some may have just stopped
        wrong = node_addresses(graph, answers, self._is_here)
        if wrong:
            return wrong
        alive = {name for name, answer in answers.items() if not answer.problem}
        here = {name for name in alive if answers[name].is_here}
        robot_links = import_module(".robot_links", __package__)
        self._robot = robot_links.RobotLinks(
            self._master, graph.of(alive), here, self._namespace
        )
        silent = listed(sorted({*answers} - alive))
        return f"{len(alive)} answer" + (f", not {silent}" if silent else "")


def _stop_if_shut_down() -> None:
    """End the walk if a signal has shut the node down.

    Raises:
        KeyboardInterrupt: Then.
    """
    rospy = sys.modules.get("rospy")
    if rospy is not None and rospy.core.is_shutdown_requested():
        raise KeyboardInterrupt
