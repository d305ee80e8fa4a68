"""The command doctor: checks from the master to the display, until the first fault.

A check is a function in the list ``CHECKS`` that queries the running system and returns
a ``Fault``, or a remark if there is none. Its results are kept in ``RunningSystem`` for
later checks.

Only the standard library is imported at the top: the command must work if the rest is
missing. From ``check_description`` on, the rest is known to be installed.
"""

from __future__ import annotations

import json
import os
import socket
import sys
import time
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from g1_description.cli import options
from g1_description.cli.running_system import (
    DEFAULT_MASTER,
    STATES,
    WAIT,
    RunningSystem,
    addresses_of,
    are_loopback,
    call,
    failed_imports,
    first_message,
    host_of,
    is_own,
    listen,
    query,
    reason_of,
)
from g1_description.cli.start import is_shut_down
from g1_description.command_line import option, own_arguments, parse, say
from g1_description.text import listed

if TYPE_CHECKING:
    import numpy as np

    from g1_description.cli.running_system import Heard
    from g1_description.robot.description import Description

NO_FAULT, FOUND = 0, 1
"""Exit codes."""

OK, FAILED, SKIPPED = "ok", "failed", "skipped"
"""States of a check."""

TF_WAIT = 1.5
"""Longest wait in [s] for nodes that may send to TF, but need not."""

MAX_OFFSET = 0.01
"""Largest distance in [m] of a joint from its place in the description: in Gazebo, the
joints of a robot that lies on the floor come apart a little."""

OF_ROS = ("rospy", "g1_description.srv", "gazebo_msgs.msg")
"""Modules that are importable once the workspace is sourced."""

PACKAGES = {
    "numpy": "'numpy<2'",
    "scipy": "scipy",
    "lxml": "lxml",
    "PIL": "Pillow",
    "ruamel.yaml": "ruamel.yaml",
    "urdf_parser_py.urdf": "urdf_parser_py",
    "diagnostic_updater": "diagnostic_updater",
    "tf2_ros": "tf2_ros",
    "pybullet": "pybullet",
}
"""Modules that the nodes import, with their names for pip."""

PIPELINE = {"clock", "tf", "tf_static", "link_states", "simulator_state"}
PIPELINE |= {"joint_states", STATES, "set_model_configuration"}
"""Base names of the topics and services between the simulator and RViz."""

DISPLAY = "roslaunch g1_description display.launch"
BROWSER = "roslaunch g1_description web.launch"
DOCTOR = "rosrun g1_description doctor"
OWN_IP = "unset ROS_HOSTNAME; export ROS_IP=$(hostname -I | cut -d' ' -f1)"
AGAIN = "  # its launch file starts it again"


@dataclass(frozen=True)
class Fault:
    """A fault of the running system."""

    name: str
    """Name, as in the documentation."""

    message: str
    fix: str
    """A command that fixes it."""


@dataclass(frozen=True)
class Result:
    """The result of a check."""

    name: str
    about: str
    state: str
    """``OK``, ``FAILED`` or ``SKIPPED``."""

    remark: str = ""
    fault: Fault | None = None


# --- the checks -----------------------------------------------------------------------


def several(
    name: str, nodes: Sequence[str], own: Sequence[str], message: str
) -> Fault | None:
    """Return a fault if several nodes do the work of one; those of ``own`` may stay."""
    if len(nodes) < 2:
        return None
    others = [node for node in nodes if node not in own] or nodes[1:]
    return Fault(name, message, f"rosnode kill {others[-1]}")


def check_python(system: RunningSystem) -> Fault | str:
    """Check that this Python can import rospy and the sourced workspace.

    Faults:
        no_workspace: the workspace is not sourced in this shell, or its Python is not
            that of ROS.
    """
    system.failed = failed_imports([*OF_ROS, *PACKAGES])
    reasons = [system.failed[name] for name in OF_ROS if name in system.failed]
    if not reasons:
        return sys.executable
    setup = Path(__file__).resolve().parents[3] / ".ws" / "devel" / "setup.bash"
    return Fault(
        "no_workspace",
        "The workspace of this package is not sourced in this shell, or "
        f"{sys.executable} is not ROS' Python: {reasons[0]}.",
        f"source {setup if setup.is_file() else '~/catkin_ws/devel/setup.bash'}",
    )


def check_packages(system: RunningSystem) -> Fault | str:
    """Check that this Python can import what the nodes need.

    PyBullet matters only if there is no simulator.

    Faults:
        no_package: the Python of the nodes lacks a package; the real Gazebo needs no
            PyBullet.
    """
    missing = [module for module in PACKAGES if module in system.failed]
    if missing == ["pybullet"]:  # which the real Gazebo does not need
        return f"{sys.executable}, without PyBullet"
    return _no_package(system, missing[0]) if missing else sys.executable


def _no_package(system: RunningSystem, module: str) -> Fault:
    package = PACKAGES[module]
    return Fault(
        "no_package",
        f"{sys.executable} cannot import {package}, which the nodes need: "
        f"{system.failed[module]}.",
        f"{sys.executable} -m pip install {package}",
    )


def check_master(system: RunningSystem) -> Fault | str:
    """Check that a master answers at ``ROS_MASTER_URI``.

    Faults:
        no_master: no master answers at ``ROS_MASTER_URI``.
    """
    uri, host = system.uri, host_of(system.uri)
    if not host:
        return Fault(
            "no_master",
            f"ROS_MASTER_URI must be an address like {DEFAULT_MASTER} (got '{uri}').",
            f"export ROS_MASTER_URI={DEFAULT_MASTER}  # or that of another host",
        )
    system.master_is_here = any(map(is_own, addresses_of(host)))
    try:
        query(uri, "getPid")
    except (OSError, LookupError) as error:
        fix = DISPLAY if system.master_is_here else f"ssh {host} roscore"
        return Fault("no_master", f"No ROS master at {uri}: {reason_of(error)}.", fix)
    return uri


def check_address(system: RunningSystem) -> Fault | str:
    """Check that ``ROS_HOSTNAME``, ``ROS_IP`` or the host's name is this machine.

    Faults:
        wrong_ros_ip: nodes of this shell register with a wrong address.
    """
    name, value = "The name of this host", socket.gethostname()
    given = [v for v in ("ROS_HOSTNAME", "ROS_IP") if v in os.environ]
    if given and os.environ[given[0]]:  # even an empty one takes precedence
        name, value = given[0], os.environ[given[0]]
    addresses = addresses_of(value)
    if not addresses:
        reason = "that name cannot be resolved here"
    elif not any(map(is_own, addresses)):
        reason = "that is another machine"
    elif not system.master_is_here and are_loopback(addresses):
        reason = "on the master's machine that address means the master itself"
    else:
        return f"{name}: {value}"
    return Fault(
        "wrong_ros_ip",
        f"{name} is {value}, but {reason}: nodes of this shell cannot be reached.",
        OWN_IP,
    )


def check_nodes(system: RunningSystem) -> Fault | str:
    """Check that nodes have valid addresses.

    Nodes between the simulator and TF must also answer.

    Faults:
        wrong_node_address: a node gave an address that cannot be resolved, or a node
            between the simulator and TF does not answer on another machine.
        dead_node: a node between the simulator and TF is registered, but has died, or
            was stopped with Ctrl-Z.
    """
    tables = [
        defaultdict(list, dict(table)) for table in query(system.uri, "getSystemState")
    ]
    system.publishers, system.subscribers, system.services = tables
    nodes = sorted({n for table in tables for ns in table.values() for n in ns})
    with ThreadPoolExecutor(16) as pool:
        faults = list(pool.map(lambda node: _query_node(system, node), nodes))
    for fault in filter(None, faults):
        return fault
    for table in tables:  # without the nodes that do not answer
        for name, owners in table.items():
            table[name] = [node for node in owners if node in system.pids]
    silent = listed(node for node in nodes if node not in system.pids)
    return f"{len(system.pids)} answer" + (
        f"; no answer from {silent}" if silent else ""
    )


def _query_node(system: RunningSystem, node: str) -> Fault | None:
    """Query a node; record it if it answers."""
    try:
        uri = str(query(system.uri, "lookupNode", node))
    except LookupError:
        return None  # it has just unregistered
    addresses = addresses_of(host_of(uri))
    is_here = any(map(is_own, addresses))
    try:
        system.pids[node] = int(query(uri, "getPid"))
        system.here.update({node} if is_here else ())
        return None
    except (OSError, LookupError) as error:
        reason = reason_of(error)
    # Dead nodes outside the pipeline do no harm.
    if addresses and not _is_in_pipeline(system, node):
        return None
    message = f"{node} does not answer at its registered address {uri}: {reason}."
    if is_here and (system.master_is_here or not are_loopback(addresses)):
        return Fault("dead_node", message, "yes | rosnode cleanup")
    fix = f"{OWN_IP}  # on its machine, in the shell that starts {node} again"
    return Fault("wrong_node_address", message, fix)


def _is_in_pipeline(system: RunningSystem, node: str) -> bool:
    """Return whether a node is part of the pipeline from simulator to TF."""
    names = {
        name.rpartition("/")[2]
        for table in (system.publishers, system.services)
        for name, nodes in table.items()
        if node in nodes
    }
    heard = (topic for topic, nodes in system.subscribers.items() if node in nodes)
    return bool(names & PIPELINE) or any(t.endswith(f"/{STATES}") for t in heard)


def check_description(system: RunningSystem) -> Fault | str:
    """Check that ``robot_description`` is a valid robot.

    Faults:
        no_description: there is no ``robot_description``.
        bad_description: ``robot_description`` is not a valid robot.
    """
    from g1_description.errors import G1DescriptionError
    from g1_description.robot.urdf import parse_urdf

    name = system.robot.description
    spaces = system.namespace.split("/") if system.namespace else []
    places = ["/".join(["", *spaces[:n], name]) for n in range(len(spaces), -1, -1)]
    places = [name] if name.startswith("/") else places
    found = ((place, system.parameter(place)) for place in places)
    place, text = next((pair for pair in found if pair[1] is not None), ("", ""))
    fix = _launch(system, "display.launch")
    if system.simulators:  # launch files refuse to start a second one
        fix = (
            "rosrun g1_description absolute_urdf.py '' > /tmp/robot.urdf && "
            f"rosparam set -t /tmp/robot.urdf {place or name}"
        )
    if not place:
        message = f"There is no parameter {name} in /{system.namespace} or above."
        return Fault("no_description", message, fix)
    try:
        system.description = parse_urdf(str(text))
    except G1DescriptionError as error:
        message = f"The parameter {place} does not hold a robot: {error}"
        return Fault("bad_description", message, fix)
    system.place = place
    return f"{place}: {len(system.description.movable_joints)} joints"


def check_meshes(system: RunningSystem) -> Fault | str:
    """Check that the meshes exist, if the simulator or RViz runs on this machine.

    Faults:
        missing_meshes: meshes of the robot do not exist.
    """
    from g1_description.files.model_files import find_folder
    from g1_description.files.uris import local_path

    if system.simulators and not {*system.simulators, *system.viewers} & system.here:
        return "not needed on this machine"
    links = system.description.links
    shapes = [shape for link in links for shape in (*link.visuals, *link.collisions)]
    names = [*dict.fromkeys(s.filename for s in shapes if s.kind == "mesh")]
    lost = [name for name in names if local_path(name, find_folder) is None]
    if not lost:
        return f"{len(names)} files"
    fix = f"{_launch(system, 'display.launch')} model:=FILE"
    return Fault(
        "missing_meshes",
        f"Meshes of the robot in {system.place} are missing on this machine: "
        f"{listed(lost)}.",
        f"{fix}  # FILE: a URDF whose meshes are found; or source their workspace",
    )


def check_simulator(system: RunningSystem) -> Fault | str:
    """Check that a simulator serves ``set_model_configuration`` and answers.

    Faults:
        no_simulator: there is no simulator.
        silent_simulator: the simulator does not answer, or there are no messages on
            ``link_states``.
    """
    from gazebo_msgs.srv import GetPhysicsProperties

    if not system.simulators:
        if "pybullet" in system.failed and not system.is_gazebo:
            return _no_package(system, "pybullet")
        service = f"{system.gazebo}/set_model_configuration"
        message = f"No simulator is running: nothing provides {service}."
        return Fault("no_simulator", message, _launch(system, "gazebo.launch"))
    service = f"{system.gazebo}/get_physics_properties"
    try:
        system.is_paused = bool(call(service, GetPhysicsProperties).pause)
    except OSError:
        return _silent_simulator(system, service)
    return listed(system.simulators)


def _silent_simulator(system: RunningSystem, name: str) -> Fault:
    """Return the fault of a simulator without an answer, or a message, of a name."""
    return _silent("silent_simulator", system.simulators[0], name, _restart(system))


def _restart(system: RunningSystem) -> str:
    """Return the command that restarts the simulator.

    Launch files refuse to start a second one, and rosnode cannot kill the real Gazebo.
    """
    pid, launch = system.pids[system.simulators[0]], _launch(system, "gazebo.launch")
    return f"kill -9 {pid}  # on its machine; then: {launch}"


def _launch(system: RunningSystem, file: str) -> str:
    """Return the command that starts a launch file, with the simulator in use."""
    return f"roslaunch g1_description {file}{' sim:=gazebo' * system.is_gazebo}"


def _silent(name: str, node: str, source: str, fix: str) -> Fault:
    message = f"{node} runs, but nothing came from {source} within {WAIT:g} s."
    return Fault(name, message, fix)


def check_clock(system: RunningSystem) -> Fault | str:
    """Check that exactly one node publishes ``/clock``, if ``/use_sim_time`` is true.

    Faults:
        no_clock: ``/use_sim_time`` is true, but nothing publishes ``/clock``.
        two_clocks: several nodes publish ``/clock``.
    """
    if not system.parameter("/use_sim_time", False):
        return "not needed, /use_sim_time is false"
    nodes = system.publishers["/clock"]
    if not nodes:
        return Fault(
            "no_clock",
            "/use_sim_time is true, but nothing publishes /clock: time does not "
            "advance.",
            "rosparam set /use_sim_time false  # then restart the nodes",
        )
    message = (
        f"Several nodes publish /clock, {listed(nodes)}: time jumps back and forth."
    )
    return several("two_clocks", nodes, system.simulators, message) or listed(nodes)


def check_time(system: RunningSystem) -> Fault | str:
    """Check that time is not paused, and ``/clock`` is published.

    Faults:
        paused: time is paused.
        silent_clock: time is not paused, but there are no messages on ``/clock``.
    """
    from rosgraph_msgs.msg import Clock

    if system.is_paused:
        return Fault(
            "paused",
            "Simulated time is paused: the robot does not move.",
            f"rosservice call {system.gazebo}/unpause_physics",
        )
    nodes = system.publishers["/clock"]
    if nodes and first_message("/clock", Clock) is None:
        return _silent("silent_clock", nodes[0], "/clock", _restart(system))
    return "runs"


def check_link_states(system: RunningSystem) -> Fault | str:
    """Check that the simulator publishes ``link_states``."""
    from gazebo_msgs.msg import LinkStates

    topic = f"{system.gazebo}/link_states"
    message = first_message(topic, LinkStates)
    if message is None:
        return _silent_simulator(system, topic)
    system.links = _links(message)
    return f"{len(message.name)} links"


def _links(message: Any) -> tuple[list[str], np.ndarray]:
    """Return the names and poses, shape (n, 7), of a message of link_states."""
    import numpy as np

    rows = []
    for pose in message.pose:
        p, q = pose.position, pose.orientation
        rows.append([p.x, p.y, p.z, q.x, q.y, q.z, q.w])
    return list(message.name), np.array(rows).reshape(-1, 7)


def check_bridge(system: RunningSystem) -> Fault | str:
    """Check that a bridge serves the namespace.

    Faults:
        no_bridge: no bridge serves the namespace.
    """
    topic, bridges = system.topic(STATES), system.bridges
    if bridges:
        return bridges[0]
    fix, others = "roslaunch g1_description bridge.launch", ""
    spaces = sorted(space for space, nodes in system.all_bridges.items() if nodes)
    if spaces:
        fix = DOCTOR + (f" --namespace {spaces[0]}" if spaces[0] else "")
        others = f"; there is one for the namespace {listed(f'/{s}' for s in spaces)}"
    message = f"No link_states_bridge publishes {topic}{others}."
    return Fault("no_bridge", message, fix)


def check_model(system: RunningSystem) -> Fault | str:
    """Check that the simulator has the bridge's model.

    Faults:
        no_model: the simulator has no model of the bridge's name.
    """
    from gazebo_msgs.srv import GetWorldProperties

    from g1_description.robot.assembly import SCOPE

    service = f"{system.gazebo}/get_world_properties"
    try:
        models = list(call(service, GetWorldProperties).model_names)
    except OSError:
        return _silent_simulator(system, service)
    name, bridge = system.robot.name, system.bridges[0]
    if name.partition(SCOPE)[0] in models:
        return name
    fix = _spawn(system)
    # A model with the robot's links may be the robot under another name.
    shown = [robot.name for robot in system.parameters.each_robot]
    parts = [link.rpartition(SCOPE) for link in system.links[0]]
    names = {*system.description.link_names}
    robots = {m for m, _, link in parts if link in names and m not in shown}
    if len(robots) == 1:
        fix = f"rosparam set {bridge}/model_name {robots.pop()} && rosnode kill "
        fix += bridge + AGAIN
    return Fault(
        "no_model",
        f"The simulator has no model '{name}', which {bridge} needs. Its models: "
        f"{listed(models) or 'none'}.",
        fix,
    )


def _spawn(system: RunningSystem) -> str:
    """Return the command that spawns the robot on its feet."""
    return (
        f"rosrun g1_description spawn_robot.py _robot_description:={system.place} "
        f"_model_name:={system.robot.name} _on_floor:=true"
    )


def check_urdf(system: RunningSystem) -> Fault | str:
    """Check that the model has the links, joint origins and axes of the robot.

    Axes are compared only where joints are not at 0.

    Faults:
        other_urdf: the model was spawned from another URDF.
    """
    from gazebo_msgs.msg import LinkStates

    name = system.robot.name
    reason = difference(system.description, name, *system.links)

    def matches(heard: Heard) -> bool:
        nonlocal reason
        if heard:
            links = _links(heard[-1][2])
            reason = difference(system.description, name, *links)
        return not reason

    if reason:  # in Gazebo, links of a robot that falls are off for half a second
        listen({f"{system.gazebo}/link_states": LinkStates}, matches)
    if not reason:
        return f"{name} matches {system.place}"
    return Fault(
        "other_urdf",
        f"The model {name} in the simulator differs from the robot in {system.place}: "
        f"{reason}.",
        f"rosservice call {system.gazebo}/delete_model {name} && {_spawn(system)}",
    )


def difference(
    description: Description, model: str, names: Sequence[str], poses: np.ndarray
) -> str:
    """Compare a simulated model with a description.

    Args:
        description: The expected robot.
        model: Its name.
        names: Scoped names of the simulator's links.
        poses: Their poses in the world, shape (n, 7).

    Returns:
        A clause on the first difference; empty if there is none.
    """
    import numpy as np

    from g1_description.bridge.estimator import LASTING, JointStateEstimator
    from g1_description.robot.assembly import SCOPE, WORLD
    from g1_description.robot.lumping import lump_fixed_joints
    from g1_description.robot.rotation import rotate
    from g1_description.robot.transform import compose, inverse

    start = model + SCOPE
    seen = {n[len(start) :]: p for n, p in zip(names, poses) if n.startswith(start)}
    bodies = {*lump_fixed_joints(description).link_names} - {WORLD}
    static = lump_fixed_joints(description, is_dynamic=False)
    missing = sorted(bodies - {*seen})
    extra = [n for n in sorted({*seen} - {*static.link_names}) if SCOPE not in n]
    if missing:
        return f"it lacks the link {listed(missing)}"
    if extra:
        return f"it has the additional link {listed(extra)}"

    for joint in static.description.joints:
        is_hinge = joint.kind in ("revolute", "continuous")
        if not is_hinge or not {joint.parent, joint.child} <= {*seen}:
            continue
        found = compose(inverse(seen[joint.parent]), seen[joint.child])
        poses_of_child = (found, joint.pose)
        origins = [p[:3] + rotate(p[3:], joint.joint_origin) for p in poses_of_child]
        distance = float(np.linalg.norm(origins[0] - origins[1]))
        if distance > MAX_OFFSET:
            return f"the origin of {joint.name} is off by {1e3 * distance:.0f} mm"

    estimator, names = JointStateEstimator({model: description}), list(names)
    for stamp in (0, round(1e9 * LASTING)):
        estimator.update(names, poses, np.zeros((len(names), 6)), stamp)
    joints = listed(estimator.problems[0].axis_residual)
    return f"the axes of {joints} differ" if joints else ""


def check_joint_states(system: RunningSystem) -> Fault | str:
    """Check that only the bridge publishes joint states.

    Faults:
        two_joint_states: another node publishes ``joint_states``, such as ``rosbag
            play`` or a second bridge.
        no_joint_states: there are no messages on ``joint_states``.
    """
    from sensor_msgs.msg import JointState

    topic = system.topic("joint_states")
    nodes = system.publishers[topic]
    own = [*system.bridges, *nodes][:1]
    publishers = f"Several nodes publish {topic}, {listed(nodes)}"
    message = f"{publishers}; only {listed(own)} should."
    two = several("two_joint_states", nodes, own, message)
    if two:
        return two
    message = first_message(topic, JointState)
    if message is None:
        fix = f"rosnode kill {own[0]}{AGAIN}"
        return _silent("no_joint_states", own[0], topic, fix)
    return f"{len(message.name)} joints"


def check_state_publisher(system: RunningSystem) -> Fault | str:
    """Check that a robot_state_publisher reads the bridge's ``tf_joint_states``.

    Faults:
        no_state_publisher: there is no robot_state_publisher.
    """
    others = system.publishers["/tf"] if system.source else []
    if not system.state_publishers and others:  # such as a bag
        return f"not needed, TF comes from {listed(others)}"
    return listed(system.state_publishers) or _no_state_publisher(system)


def _no_state_publisher(system: RunningSystem) -> Fault:
    message = f"No robot_state_publisher subscribes to {system.tf_input}."
    return Fault("no_state_publisher", message, _start_state_publisher(system))


def _start_state_publisher(system: RunningSystem) -> str:
    """Return the command that starts a robot_state_publisher."""
    namespace = f" __ns:={system.namespace}" if system.namespace else ""
    return (
        "rosrun robot_state_publisher robot_state_publisher "
        f"joint_states:={system.tf_input} _ignore_timestamp:=true{namespace} "
        # The parameter of a previous one may still be set.
        f"_tf_prefix:='{system.robot.frame_prefix.rstrip('/')}'"
    )


def check_tf(system: RunningSystem) -> Fault | str:
    """Check that TF has all frames of the robot, each from one node.

    Faults:
        two_tf_owners: several nodes publish one edge of TF, or a frame has two parents.
        no_tf: TF lacks edges of the robot.
    """
    from tf2_msgs.msg import TFMessage

    expected = system.edges()
    topics = dict.fromkeys(("/tf", "/tf_static"), TFMessage)
    publishers = {(topic, n) for topic in topics for n in system.publishers[topic]}
    end = time.monotonic() + TF_WAIT

    def is_enough(heard: Heard) -> bool:
        came = publishers <= {(topic, sender) for topic, sender, _ in heard}
        is_due = came or time.monotonic() > end
        return is_due and not missing_edges(tf_edges(heard), expected)

    edges = tf_edges(listen(topics, is_enough))
    # All bridges publish the same static edge from the world to the map.
    bridges = [node for nodes in system.all_bridges.values() for node in nodes]
    two = two_tf_owners(edges, expected, [*bridges, *system.state_publishers])
    lost = missing_edges(edges, expected)
    if two or not lost:
        return two or f"{len(edges)} edges"
    if not system.state_publishers:
        return _no_state_publisher(system)
    is_base = lost[0] in system.base_edges()
    owner = system.bridges[0] if is_base else system.state_publishers[0]
    then = AGAIN if is_base else f"; {_start_state_publisher(system)}"
    edges_lost = listed(f"{parent} -> {child}" for parent, child in lost)
    message = f"TF lacks {edges_lost}, which {owner} should publish."
    return Fault("no_tf", message, f"rosnode kill {owner}{then}")


def tf_edges(heard: Heard) -> dict[str, set[tuple[str, str]]]:
    """Collect the edges of TF: pairs of sender and parent, by the child's frame."""
    found: dict[str, set[tuple[str, str]]] = {}
    for _, sender, message in heard:
        for edge in message.transforms:
            pair = sender, edge.header.frame_id.lstrip("/")
            found.setdefault(edge.child_frame_id.lstrip("/"), set()).add(pair)
    return found


def missing_edges(
    edges: Mapping[str, set[tuple[str, str]]], expected: Iterable[tuple[str, str]]
) -> list[tuple[str, str]]:
    """List the expected edges, parent and child, that are missing."""
    found = {(p, child) for child, pairs in edges.items() for _, p in pairs}
    return [edge for edge in expected if edge not in found]


def two_tf_owners(
    edges: Mapping[str, set[tuple[str, str]]],
    expected: Iterable[tuple[str, str]],
    own: Sequence[str],
) -> Fault | None:
    """Look for a frame of the robot with two parents, or from two nodes.

    Args:
        edges: Pairs of sender and parent, by the child's frame.
        expected: The robot's edges, parent and child; other frames are ignored.
        own: The bridges and the robot_state_publisher, which may all publish an edge:
            while time is paused, the bridge publishes fixed joints, too.
    """
    for child in sorted({child for _, child in expected} & {*edges}):
        nodes = sorted({node for node, _ in edges[child]})
        parents = sorted({parent for _, parent in edges[child]})
        if len(parents) == 1 and (len(nodes) == 1 or {*nodes} <= {*own}):
            continue
        other = ([node for node in nodes if node not in own] or nodes)[-1]
        edge = listed(f"{parent} -> {child}" for parent in parents)
        return Fault(
            "two_tf_owners",
            f"Several nodes publish {edge} on TF, {listed(nodes)}: the robot jumps "
            "back and forth.",
            f"rosnode kill {other}",
        )
    return None


def check_diagnostics(system: RunningSystem) -> Fault | str:
    """Check that the bridge reports no fault on ``/diagnostics``.

    Faults:
        bad_diagnostics: the bridge reports another problem on ``/diagnostics``, or
            nothing.
    """
    from diagnostic_msgs.msg import DiagnosticArray

    node, topic = system.bridges[0], "/diagnostics"

    def reports(heard: Heard) -> list[str]:
        return [bad_status(m.status) for _, sender, m in heard if sender == node]

    heard = listen({topic: DiagnosticArray}, lambda heard: "" in reports(heard))
    found = reports(heard)
    if "" in found:
        return node
    report = found[-1] if found else f"nothing within {WAIT:g} s"
    fix = f"rostopic echo {topic}  # the report with all figures"
    return Fault("bad_diagnostics", f"{node} reports on {topic}: {report}.", fix)


def bad_status(statuses: Iterable[Any]) -> str:
    """Return name and message of the first bad status; of commands, of errors only."""
    for status in sorted(statuses, key=lambda status: status.name):
        if status.level > (1 if status.name.endswith(": commands") else 0):
            return f"{status.name}: {status.message}"
    return ""


def check_picture(system: RunningSystem) -> Fault | str:
    """Check that RViz or the browser view runs, or ``DISPLAY`` is empty.

    Faults:
        no_picture: neither RViz nor the browser view runs, though there is a screen.
    """
    if system.viewers:
        return listed(system.viewers)
    if not os.environ.get("DISPLAY"):
        return f"not needed without a screen; in a browser: {BROWSER}"
    return Fault(
        "no_picture",
        "Neither RViz nor the browser view is running.",
        f"roslaunch g1_description rviz.launch  # or, if RViz cannot start: {BROWSER}",
    )


CHECKS: list[tuple[str, str, Callable[[RunningSystem], Fault | str]]] = [
    ("python", "Python of ROS and sourced workspace", check_python),
    ("packages", "Python packages of the nodes", check_packages),
    ("master", "answer of the master", check_master),
    ("address", "reachable address for nodes of this shell", check_address),
    ("nodes", "answers of the nodes", check_nodes),
    ("description", "robot in robot_description", check_description),
    ("meshes", "meshes of the robot on this machine", check_meshes),
    ("simulator", "answer of a simulator", check_simulator),
    ("clock", "one publisher of the time", check_clock),
    ("time", "advance of simulated time", check_time),
    ("link_states", "link states from the simulator", check_link_states),
    ("bridge", "bridge from link states to joint states", check_bridge),
    ("model", "the bridge's model in the simulator", check_model),
    ("urdf", "agreement of the model with robot_description", check_urdf),
    ("joint_states", "one publisher of joint states", check_joint_states),
    (
        "state_publisher",
        "robot_state_publisher, subscribed to joint states",
        check_state_publisher,
    ),
    ("tf", "TF, complete and with one publisher per edge", check_tf),
    ("diagnostics", "diagnostics of the bridge", check_diagnostics),
    ("picture", "RViz or the browser view", check_picture),
]
"""Name, description and function of each check. They run in this order: each needs the
results of those before it."""

CHECK_NAMES = [name for name, _, _ in CHECKS]

OF_SIMULATION = {"simulator", "time", "link_states", "bridge", "model", "urdf"}
OF_SIMULATION |= {"diagnostics"}
"""Checks that do not apply if joint states come from a bag or a real robot."""


# --- the command ----------------------------------------------------------------------


def run_checks(namespace: str, names: Sequence[str]) -> Iterator[Result]:
    """Run checks one after another, until the first fault.

    Args:
        namespace: Prefix of the robot's topics, without leading and trailing slashes.
        names: The names of the checks.

    Raises:
        KeyboardInterrupt: If a signal has shut the node down.

    Faults:
        unfinished: a query failed, such as one to a master that is too busy.
    """
    system = RunningSystem(namespace)
    checks = iter([check for check in CHECKS if check[0] in names])
    for name, about, check in checks:
        try:
            if name in OF_SIMULATION and system.source:
                found = f"not needed, joint states come from {system.source}"
            else:
                found = check(system)
        except (OSError, LookupError, TypeError, ValueError, SystemExit) as error:
            found = check_master(system)  # it may have died meanwhile
            if not isinstance(found, Fault):
                message = f"The check '{name}' failed: {reason_of(error)}."
                again = f"{DOCTOR}  # run again when this machine is less busy"
                found = Fault("unfinished", message, again)
        if is_shut_down():
            raise KeyboardInterrupt
        if isinstance(found, Fault):
            yield Result(name, about, FAILED, found.name, found)
            break
        yield Result(name, about, OK, found)
    for name, about, _ in checks:
        yield Result(name, about, SKIPPED)


@dataclass(frozen=True)
class DoctorOptions:
    """Check the pipeline from the master to the display.

    Stops at the first fault and suggests a fix. Changes nothing. The exit code is 0
    without a fault, 1 with a fault, 2 if the command line is wrong.
    """

    json: bool = option(
        "print JSON: ok, fault, message, fix, and checks with name, state, about and "
        "remark",
        False,
    )
    namespace: str = options.namespace()
    until: str = option(
        f"last check to run: {', '.join(CHECK_NAMES)}",
        CHECK_NAMES[-1],
        choices=CHECK_NAMES,
        metavar="CHECK",
    )


def main() -> None:
    """Run the command, and exit with its code."""
    args = parse(DoctorOptions, "doctor", own_arguments())
    results = []
    for result in run_checks(
        args.namespace, CHECK_NAMES[: CHECK_NAMES.index(args.until) + 1]
    ):
        results.append(result)
        if not args.json:
            remark = f" ({result.remark})" if result.remark else ""
            say(f"{result.state:7}  {result.name:15}  {result.about}{remark}")
    fault = next((result.fault for result in results if result.fault), None)
    if args.json:
        keys = ("name", "state", "about", "remark")
        content = {
            "ok": fault is None,
            "fault": fault and fault.name,
            "message": fault and fault.message,
            "fix": fault and fault.fix,
            "checks": [{key: getattr(r, key) for key in keys} for r in results],
        }
        say(json.dumps(content, indent=2))
    elif fault:
        say(f"\ndoctor: {fault.message}\n        {fault.fix}")
    else:
        say("\ndoctor: no fault found.")
    sys.exit(FOUND if fault else NO_FAULT)
