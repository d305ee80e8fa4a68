"""The running system of the command doctor: answers of master, nodes and topics.

Only the standard library is imported at the top: the command must work if the rest is
missing.

Subscribes: /clock, /diagnostics, /tf, /tf_static, <gazebo>/link_states, joint_states
Calls: <gazebo>/get_physics_properties, <gazebo>/get_world_properties
"""

from __future__ import annotations

import contextlib
import json
import os
import queue
import socket
import subprocess
import sys
import threading
from collections import defaultdict
from collections.abc import Callable, Iterable, Mapping
from dataclasses import fields
from functools import cached_property
from http.client import HTTPException
from typing import TYPE_CHECKING, Any, Dict, List, Tuple
from urllib.parse import urlparse
from xml.parsers.expat import ExpatError
from xmlrpc.client import Error, ServerProxy

from g1_description.text import listed

if TYPE_CHECKING:
    import numpy as np

    from g1_description.bridge.parameters import BridgeParameters, RobotParameters
    from g1_description.robot.description import Description

    Nodes = Dict[str, List[str]]  # by the full name of a topic or a service
    Heard = List[Tuple[str, str, Any]]  # topics, senders and messages

WAIT = 5.0
"""Longest wait for an answer or a message, in [s] of wall time."""

IMPORT_TIMEOUT = 20.0
"""Longest wait for imports in [s]: the disk may be slow the first time."""

DEFAULT_MASTER = "http://localhost:11311"

STATES = "tf_joint_states"
"""Base name of a topic that only a bridge publishes, for robot_state_publisher."""

BRIDGE = "/link_states_bridge"
"""The bridge's name in the launch files."""

PAGE_PARAMETERS = {"controls", "port", "read_only"}
"""Parameters that identify the node of the browser view."""

RVIZ_SERVICE = "/reload_shaders"
"""Base name of a service of each RViz."""


def within(seconds: float, function: Callable[..., Any], *given: Any) -> Any:
    """Call a function with a timeout, in a thread that is abandoned after it.

    Raises:
        TimeoutError: If it takes longer; also the errors of the function.
    """
    results: queue.Queue = queue.Queue()

    def call() -> None:
        try:
            results.put((function(*given), None))
        except Exception as error:  # raised again below
            results.put((None, error))

    threading.Thread(target=call, daemon=True).start()
    try:
        value, error = results.get(timeout=seconds)
    except queue.Empty:
        raise TimeoutError(f"no answer within {seconds:g} s") from None
    if error is not None:
        raise error
    return value


def query(uri: str, method: str, *given: Any) -> Any:
    """Call a method of the master or a node, by ROS' XML-RPC interface.

    Raises:
        OSError: If nothing answers, or not by ROS' protocol.
        LookupError: If the call failed on the other side.
    """

    def call() -> tuple[int, str, Any]:
        code, text, value = getattr(ServerProxy(uri), method)("/doctor", *given)
        return int(code), str(text), value

    try:
        code, text, value = within(WAIT, call)
    except (Error, HTTPException, ExpatError, TypeError, ValueError):
        raise OSError("the program that answers there is not a ROS program") from None
    if code != 1:
        raise LookupError(text)
    return value


def reason_of(error: BaseException) -> str:
    """Describe an error of a connection."""
    if isinstance(error, socket.gaierror):
        return "its host name cannot be resolved here"
    if isinstance(error, ConnectionRefusedError):
        return "nothing listens there"
    if isinstance(error, OSError):
        return (error.strerror or str(error)).lower()
    return f"{type(error).__name__}: {error}"


def host_of(uri: str) -> str:
    """Read the host of an address; empty if it is none."""
    try:
        return urlparse(uri).hostname or ""
    except ValueError:
        return ""


def addresses_of(host: str) -> list[str]:
    """Resolve a host name; empty if that fails."""
    try:
        found = within(WAIT, socket.getaddrinfo, host, None)
    except (OSError, UnicodeError):
        return []
    return list(dict.fromkeys(entry[4][0] for entry in found))


def is_own(address: str) -> bool:
    """Return whether an address belongs to this machine, so that it can be bound."""
    family = socket.AF_INET6 if ":" in address else socket.AF_INET
    with contextlib.suppress(OSError), socket.socket(family, socket.SOCK_STREAM) as one:
        one.bind((address, 0))
        return True
    return False


def are_loopback(addresses: Iterable[str]) -> bool:
    """Return whether all addresses are loopback addresses."""
    return all(a.startswith("127.") or a == "::1" for a in addresses)


IMPORTS = """
import importlib, json, sys
found = {}
for name in sys.argv[1:]:
    try:
        importlib.import_module(name)
    except BaseException as error:
        found[name] = "%s: %s" % (type(error).__name__, error)
print("\\n" + json.dumps(found))
"""


def failed_imports(names: Iterable[str]) -> dict[str, str]:
    """Import modules in another process, which may crash; return errors by module."""
    try:
        run = subprocess.run(
            [sys.executable, "-c", IMPORTS, *names],
            stdin=subprocess.DEVNULL,
            capture_output=True,
            timeout=IMPORT_TIMEOUT,
            check=False,
        )
        return dict(json.loads(run.stdout.decode().splitlines()[-1]))
    except (OSError, ValueError, IndexError, subprocess.TimeoutExpired) as error:
        reason = f"importing it fails ({error})"
    return dict.fromkeys(names, reason)


def _start_node() -> None:
    import rospy

    from g1_description.ros.lifecycle import start_node

    if not rospy.core.is_initialized():
        start_node("doctor", anonymous=True, disable_rosout=True)


def listen(topics: Mapping[str, Any], is_enough: Callable[[Heard], bool]) -> Heard:
    """Subscribe to topics for a while.

    Args:
        topics: Message classes by topic.
        is_enough: Returns whether the messages so far are enough.

    Returns:
        Topics, senders and messages.

    Raises:
        ROSInterruptException: If the node is shut down.
    """
    import rospy

    from g1_description.ros.waiting import wait_until

    _start_node()
    heard: Heard = []

    def on_message(message: Any, topic: str) -> None:
        header = message._connection_header or {}
        heard.append((topic, header.get("callerid", ""), message))

    subscribers = [
        rospy.Subscriber(topic, kind, on_message, callback_args=topic, queue_size=100)
        for topic, kind in topics.items()
    ]
    wait_until(lambda: is_enough(list(heard)), WAIT, period=0.05)
    for subscriber in subscribers:
        subscriber.unregister()
    return list(heard)


def first_message(topic: str, kind: Any) -> Any:
    """Wait for any message of a topic; None if none comes."""
    heard = listen({topic: kind}, bool)
    return heard[0][2] if heard else None


def call(service: str, kind: Any) -> Any:
    """Call a service that may hang, or not be there yet.

    Raises:
        OSError: If there is no answer.
    """
    import rospy

    _start_node()
    proxy = rospy.ServiceProxy(service, kind)

    def answer() -> Any:
        proxy.wait_for_service(WAIT)
        return proxy()

    try:
        return within(WAIT, answer)
    except (rospy.ServiceException, rospy.ROSException) as error:
        raise OSError(str(error)) from None


class RunningSystem:
    """The running system, as known from the checks so far."""

    def __init__(self, namespace: str) -> None:
        self.namespace = namespace
        """Namespace of the robot's topics, without outer slashes."""
        self.uri = os.environ.get("ROS_MASTER_URI") or DEFAULT_MASTER
        self.master_is_here = True
        self.failed: dict[str, str] = {}
        """Errors of modules that this Python cannot import."""
        self.publishers: Nodes = defaultdict(list)
        self.subscribers: Nodes = defaultdict(list)
        self.services: Nodes = defaultdict(list)
        self.pids: dict[str, int] = {}
        """Process ids of the nodes that answer."""
        self.here: set[str] = set()
        """The nodes on this machine."""
        self.place = ""
        """Parameter of the robot's description."""
        self.description: Description = None  # type: ignore[assignment]
        self.is_paused = False
        self.links: tuple[list[str], np.ndarray] = None  # type: ignore[assignment]
        """Scoped names and poses, shape (n, 7), of the simulator's links."""

    def parameter(self, name: str, default: Any = None) -> Any:
        """Ask the master for a parameter."""
        try:
            return query(self.uri, "getParam", name)
        except LookupError:
            return default

    def topic(self, name: str) -> str:
        """Return the full name of a topic of the robot."""
        return f"/{self.namespace}/{name}" if self.namespace else f"/{name}"

    def _parameters_of(self, node: str) -> dict[str, Any]:
        found = self.parameter(node, {})
        return found if isinstance(found, dict) else {}

    @cached_property
    def bridges(self) -> list[str]:
        """The bridges of the namespace, that of the launch files first."""
        nodes = self.publishers[self.topic(STATES)]
        return sorted(nodes, key=lambda node: (node != BRIDGE, node))

    @cached_property
    def all_bridges(self) -> dict[str, list[str]]:
        """The bridges by namespace."""
        found = self.publishers.items()
        ends = f"/{STATES}"
        return {t[: -len(ends)].strip("/"): n for t, n in found if t.endswith(ends)}

    @cached_property
    def parameters(self) -> BridgeParameters:
        """The bridge's parameters; the defaults without a bridge."""
        from g1_description.bridge.parameters import BridgeParameters
        from g1_description.errors import G1DescriptionError

        own = self._parameters_of(self.bridges[0]) if self.bridges else {}
        names = {field.name for field in fields(BridgeParameters)}
        try:
            return BridgeParameters(**{name: own[name] for name in names & {*own}})
        except (G1DescriptionError, TypeError):  # a bridge does not start with these
            return BridgeParameters()

    @property
    def is_gazebo(self) -> bool:
        """Whether the simulator that runs, or was launched last, is the real Gazebo."""
        if self.simulators:
            return not self.services[f"{self.gazebo}/step"]
        return bool(self.parameter(f"{self.gazebo}/sim") == "gazebo")

    @property
    def gazebo(self) -> str:
        """The simulator's namespace."""
        return self.parameters.gazebo

    @cached_property
    def robot(self) -> RobotParameters:
        """The robot of the namespace among those of the bridge."""
        robots = self.parameters.each_robot
        return next((r for r in robots if r.namespace == self.namespace), robots[0])

    @cached_property
    def simulators(self) -> list[str]:
        """The simulator's node; empty if there is none."""
        return self.services[f"{self.gazebo}/set_model_configuration"]

    @cached_property
    def source(self) -> str:
        """The nodes that publish joint states without a bridge and a simulator."""
        if any(self.all_bridges.values()) or self.simulators:
            return ""
        return listed(self.publishers[self.topic("joint_states")])

    @cached_property
    def viewers(self) -> list[str]:
        """The nodes that show the robot."""
        found = self.services.items()
        rviz = [ns for name, ns in found if name.endswith(RVIZ_SERVICE)]
        # Without an open page the browser view subscribes to nothing.
        pages = [n for n in self.pids if {*self._parameters_of(n)} >= PAGE_PARAMETERS]
        return sorted({*pages, *(node for nodes in rviz for node in nodes)})

    @property
    def tf_input(self) -> str:
        """The topic of joint states that TF is made of."""
        return self.topic("joint_states" if self.source else STATES)

    @cached_property
    def state_publishers(self) -> list[str]:
        """The nodes that publish TF from it."""
        readers = self.subscribers[self.tf_input]
        return [node for node in readers if node in self.publishers["/tf"]]

    def base_edges(self) -> list[tuple[str, str]]:
        """List the edges of TF that the bridge publishes: parent and child."""
        from g1_description.bridge.parameters import base_child, static_edges

        prefix, p = self.robot.frame_prefix, self.parameters
        base = base_child(p, self.description)
        moving = [(p.map_frame, prefix + base)] if base else []
        return [*moving, *static_edges(p, self.description, prefix)]

    def edges(self) -> list[tuple[str, str]]:
        """List the edges that TF should have: parent and child."""
        from g1_description.robot.description import MOVABLE

        prefix = self.robot.frame_prefix
        joints = [
            (prefix + joint.parent, prefix + joint.child)
            for joint in self.description.joints
            if joint.kind in (*MOVABLE, "fixed")
        ]
        return joints if self.source else [*self.base_edges(), *joints]
