"""The links between the robot's description and TF, as they are asked for."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields
from functools import cached_property, lru_cache
from typing import Any

import rospkg
import rospy

from g1_description.bridge.parameters import (
    BridgeParameters,
    RobotParameters,
    base_child,
    static_edges,
)
from g1_description.cli.doctor import robot
from g1_description.cli.doctor.faults import ASKED_PROCESS, Fault, fault
from g1_description.cli.doctor.master import Master
from g1_description.cli.doctor.nodes import STATES, Graph
from g1_description.cli.doctor.traffic import WAIT, Traffic
from g1_description.errors import G1DescriptionError
from g1_description.files.model_files import share_folder
from g1_description.files.uris import local_path
from g1_description.robot.description import MOVABLE, Description
from g1_description.robot.urdf import parse_urdf
from g1_description.text import listed

BRIDGE = "/link_states_bridge"
"""The bridge's name in the launch files."""

PAGE_PARAMETERS = {"controls", "port", "read_only"}
"""Parameters that tell the node of the browser view."""

RVIZ_SERVICE = "/reload_shaders"
"""A service that each RViz has, behind its name."""


class RobotSetup:
    """One robot, as the master knows it."""

    def __init__(self, master: Master, graph: Graph, namespace: str) -> None:
        """Find the bridge and its parameters.

        Args:
            master: The master, which has answered.
            graph: Which nodes publish, subscribe and serve what.
            namespace: Of the robot's topics, without slashes around.
        """
        self.master, self.graph, self.namespace = master, graph, namespace
        nodes = graph.publishers.get(self.topic(STATES), [])
        self.bridges = sorted(nodes, key=lambda node: (node != BRIDGE, node))
        """Those of the namespace, the one of the launch files first."""
        self._parameters = self._read_parameters()
        self.gazebo = self._parameters.gazebo
        """The simulator's namespace."""
        self.robot = self._find_robot()

    def topic(self, name: str) -> str:
        """Return the full name of a topic of the robot."""
        return f"/{self.namespace}/{name}" if self.namespace else f"/{name}"

    def publishers(self, topic: str) -> list[str]:
        """List the nodes that publish a topic, by its full name."""
        return self.graph.publishers.get(topic, [])

    def _of_node(self, node: str) -> dict[str, Any]:
        """Return the private parameters of a node."""
        found = self.master.parameter(node, {})
        return found if isinstance(found, dict) else {}

    def _read_parameters(self) -> BridgeParameters:
        """Read the bridge's parameters; the defaults where there is no bridge."""
        own = self._of_node(self.bridges[0]) if self.bridges else {}
        names = {field.name for field in fields(BridgeParameters)}
        try:
            return BridgeParameters(**{name: own[name] for name in names & {*own}})
        except (G1DescriptionError, TypeError):  # with these no bridge starts
            return BridgeParameters()

    def _find_robot(self) -> RobotParameters:
        """Find the robot of the namespace among those of the bridge."""
        robots = self._parameters.each_robot
        return next((r for r in robots if r.namespace == self.namespace), robots[0])

    @property
    def bridged_namespaces(self) -> list[str]:
        """The namespaces that a bridge serves."""
        topics = (t for t in self.graph.publishers if t.endswith(f"/{STATES}"))
        return sorted(topic.rpartition("/")[0].strip("/") for topic in topics)

    @property
    def models(self) -> list[str]:
        """The models that the bridge shows."""
        return [robot.name for robot in self._parameters.each_robot]

    @property
    def simulators(self) -> list[str]:
        """The simulator's node; empty if there is none."""
        name = f"{self.gazebo}/set_model_configuration"
        return self.graph.services.get(name, [])

    @property
    def source(self) -> str:
        """What joint states come from where neither bridge nor simulator runs."""
        if self.bridged_namespaces or self.simulators:
            return ""
        return listed(self.publishers(self.topic("joint_states")))

    @property
    def viewers(self) -> list[str]:
        """The nodes that show the robot."""
        names = [name for name in self.graph.services if name.endswith(RVIZ_SERVICE)]
        rviz = [node for name in names for node in self.graph.services[name]]
        # Without an open page the browser view subscribes to nothing.
        nodes = self.graph.nodes
        return rviz + [n for n in nodes if {*self._of_node(n)} >= PAGE_PARAMETERS]

    @property
    def made_from(self) -> str:
        """The topic that TF is made from."""
        return self.topic("joint_states" if self.source else STATES)

    @property
    def state_publishers(self) -> list[str]:
        """The nodes that make TF of it."""
        readers = self.graph.subscribers.get(self.made_from, [])
        return [node for node in readers if node in self.publishers("/tf")]

    @property
    def prefix(self) -> str:
        """What stands before the names of the robot's frames, without its slash."""
        return self.robot.frame_prefix.rstrip("/")

    def base_edges(self, description: Description) -> list[tuple[str, str]]:
        """List the edges that the bridge sends: parent and child."""
        prefix, p = self.robot.frame_prefix, self._parameters
        base = base_child(p, description)
        moving = [(p.map_frame, prefix + base)] if base else []
        return [*moving, *static_edges(p, description, prefix)]

    def shared_edges(
        self, description: Description
    ) -> dict[tuple[str, str], list[str]]:
        """Give the bridges that may send each static edge: all send the same."""
        found = self.graph.publishers.items()
        bridges = [n for t, nodes in found if t.endswith(f"/{STATES}") for n in nodes]
        edges = static_edges(self._parameters, description, self.robot.frame_prefix)
        return dict.fromkeys(edges, bridges)

    def edges(self, description: Description) -> list[tuple[str, str]]:
        """List the edges that TF should have: parent and child."""
        prefix = self.robot.frame_prefix
        joints = [
            (prefix + joint.parent, prefix + joint.child)
            for joint in description.joints
            if joint.kind in (*MOVABLE, "fixed")
        ]
        return joints if self.source else [*self.base_edges(description), *joints]


FAILURES = (rospy.ServiceException, rospy.ROSException, OSError)
"""What calling a service may raise."""

OF_VIEW = ("description", "meshes", "clock", "joint_states", "state_publisher", "tf")
"""The links that there are where joint states come from a bag or a real robot."""


class RobotLinks:
    """Looks at the links of one robot."""

    def __init__(
        self, master: Master, graph: Graph, here: set[str], namespace: str
    ) -> None:
        """Find the robot's nodes.

        Args:
            master: The master, which has answered.
            graph: Which nodes publish, subscribe and serve what.
            here: The nodes on this machine.
            namespace: Of the robot's topics, without slashes around.
        """
        self._setup = RobotSetup(master, graph, namespace)
        self._here = here
        self._place = ""
        self._known: Description | None = None

    def look(self, name: str) -> Fault | str:
        """Look at a link: return its fault, or a remark where it is whole."""
        look: dict[str, Callable[[], Fault | str]] = {
            "description": self._description,
            "meshes": self._meshes,
            "simulator": self._simulator,
            "clock": self._clock,
            "time": self._time,
            "link_states": self._link_states,
            "bridge": self._bridge,
            "model": self._model,
            "urdf": self._urdf,
            "joint_states": self._joint_states,
            "state_publisher": self._state_publisher,
            "tf": self._tf,
            "diagnostics": self._diagnostics,
        }
        if self._setup.source and name not in OF_VIEW:
            return f"not needed, joint states come from {self._setup.source}"
        return look[name]()

    def viewers(self) -> str:
        """Name the nodes that show the robot; empty if there is none."""
        return listed(self._setup.viewers)

    def close(self) -> None:
        """End what listens, if anything does."""
        if "_traffic" in self.__dict__:  # else asking for it would begin it
            self._traffic.close()

    @cached_property
    def _traffic(self) -> Traffic:
        """What listens and asks; it is a node from the first use on."""
        return Traffic()

    @property
    def _read(self) -> Description:
        """The description, after it was read."""
        if self._known is None:
            raise RuntimeError("the description was not read")
        return self._known

    def _description(self) -> Fault | str:
        """Read the robot of the parameter server."""
        master, space = self._setup.master, self._setup.namespace
        name = self._setup.robot.description
        place = master.find_parameter(name, space)
        has_simulator = bool(self._setup.simulators)
        if not place:
            cure = robot.cure_of_description(name, has_simulator)
            words = {"parameter": name, "namespace": space, "cure": cure}
            return fault("no_description", **words)
        try:
            self._known = parse_urdf(str(master.parameter(place)))
        except G1DescriptionError as error:
            cure = robot.cure_of_description(place, has_simulator)
            return fault("bad_description", parameter=place, reason=error, cure=cure)
        self._place = place
        return f"{place}: {len(self._known.movable_joints)} joints"

    def _meshes(self) -> Fault | str:
        """Look for the meshes, where somebody on this machine draws or loads them."""
        users = {*self._setup.simulators, *self._setup.viewers}
        if self._setup.simulators and not users & self._here:
            return "not needed on this machine"
        shapes = [
            shape
            for link in self._read.links
            for shape in (*link.visuals, *link.collisions)
            if shape.kind == "mesh"
        ]
        names = dict.fromkeys(shape.filename for shape in shapes)
        lost = [name for name in names if local_path(name, _package_folder) is None]
        found = robot.meshes(lost, self._place, str(share_folder()))
        return found or f"{len(names)} files"

    def _simulator(self) -> Fault | str:
        """Ask the simulator."""
        gazebo = self._setup.gazebo
        if not self._setup.simulators:
            return fault("no_simulator", service=f"{gazebo}/set_model_configuration")
        try:
            self._is_paused = self._traffic.is_paused(gazebo)
        except FAILURES:
            return self._hung("get_physics_properties")
        return listed(self._setup.simulators)

    def _clock(self) -> Fault | str:
        """Look who publishes the time."""
        if not self._setup.master.parameter("/use_sim_time", False):
            return "not needed, /use_sim_time is false"
        nodes = self._setup.publishers("/clock")
        if not nodes:
            return fault("no_clock")
        two = robot.publishers("two_clocks", nodes, self._setup.simulators)
        return two or listed(nodes)

    def _time(self) -> Fault | str:
        """Ask whether time runs."""
        if self._is_paused:
            return fault("paused", gazebo=self._setup.gazebo)
        nodes = self._setup.publishers("/clock")
        if nodes and not self._traffic.has_time():
            return self._restart("silent_clock", nodes[0])
        return "runs"

    def _link_states(self) -> Fault | str:
        """Listen to the simulator."""
        topic = f"{self._setup.gazebo}/link_states"
        nodes = self._setup.publishers(topic)
        if not nodes:
            node = self._setup.simulators[0]
            return self._restart("no_link_states", node, topic=topic)
        self._states = self._traffic.link_states(topic)
        if self._states is None:
            return self._restart("silent_simulator", nodes[0], topic=topic)
        return f"{len(self._states[0])} links"

    def _bridge(self) -> Fault | str:
        """Look for the bridge."""
        topic, bridges = self._setup.topic(STATES), self._setup.bridges
        if not bridges:
            return robot.no_bridge(topic, self._setup.bridged_namespaces)
        two = robot.publishers("two_bridges", bridges, [BRIDGE], topic=topic)
        return two or bridges[0]

    def _model(self) -> Fault | str:
        """Ask the simulator for the bridge's model."""
        try:
            models = self._traffic.models(self._setup.gazebo)
        except FAILURES:
            return self._hung("get_world_properties")
        name, bridge = self._setup.robot.name, self._setup.bridges[0]
        names = self._states[0] if self._states else ()
        robots = robot.models_of(self._read, names, self._setup.models)
        return robot.model(name, models, robots, bridge, self._place) or name

    def _urdf(self) -> Fault | str:
        """Compare the model with the description."""
        name, states = self._setup.robot.name, self._states
        reason = states and robot.difference(self._read, name, *states)
        if not reason:
            return f"{name} is the robot on {self._place}"
        cure = robot.spawning(name, self._place)
        words = {"parameter": self._place, "gazebo": self._setup.gazebo, "cure": cure}
        return fault("other_urdf", model=name, reason=reason, **words)

    def _joint_states(self) -> Fault | str:
        """Listen to the joint states."""
        topic = self._setup.topic("joint_states")
        nodes = self._setup.publishers(topic)
        own = self._setup.bridges or nodes[:1]
        words = {"topic": topic, "own": listed(own)}
        two = robot.publishers("two_joint_states", nodes, own, **words)
        if two:
            return two
        found = self._traffic.joint_states(topic)
        if found is None:
            return _silent("no_joint_states", own[0], topic=topic)
        return f"{len(found)} joints"

    def _state_publisher(self) -> Fault | str:
        """Look for what makes TF of joint states."""
        setup = self._setup
        found = listed(setup.state_publishers)
        others = setup.publishers("/tf") if setup.source else []
        if not found and others:  # such as a bag
            return f"not needed, TF comes from {listed(others)}"
        return found or robot.no_state_publisher(setup.made_from, setup.prefix)

    def _tf(self) -> Fault | str:
        """Listen to TF."""
        setup, known = self._setup, self._read
        expected = setup.edges(known)
        found = self._traffic.tf(
            setup.graph.publishers,
            lambda edges: not robot.missing_edges(edges, expected),
        )
        chain = [*setup.bridges, *setup.state_publishers]
        two = robot.tf_owners(found, chain, expected, setup.shared_edges(known))
        lost = robot.missing_edges(found, expected)
        if two or not lost:
            return two or f"{len(found)} edges"
        start = setup.made_from, setup.prefix
        if not setup.state_publishers:
            return robot.no_state_publisher(*start)
        owners = (setup.bridges or [""])[0], setup.state_publishers[0]
        return robot.no_tf(lost, setup.base_edges(known), owners, start)

    def _diagnostics(self) -> Fault | str:
        """Hear what the bridge says of itself; what is bad must be so once more."""
        node = self._setup.bridges[0]
        rounds = [self._traffic.diagnostics(node)]
        if robot.reports(node, rounds, WAIT):
            rounds.append(self._traffic.diagnostics(node))
        return robot.reports(node, rounds, WAIT) or node

    def _hung(self, service: str) -> Fault:
        """Tell that the simulator does not answer."""
        name = f"{self._setup.gazebo}/{service}"
        return self._restart("hung_simulator", self._setup.simulators[0], service=name)

    def _restart(self, name: str, node: str, **words: str) -> Fault:
        """Tell that a simulator has to be started again; a hung one tells no pid."""
        process = self._setup.master.process_of(node)
        process = process or ASKED_PROCESS.format(node=node)
        return _silent(name, node, process=process, **words)


def _silent(name: str, node: str, **words: str) -> Fault:
    """Tell that nothing came in time."""
    return fault(name, node=node, seconds=WAIT, **words)


@lru_cache(maxsize=None)
def _package_folder(name: str) -> str | None:
    """Find a package that is sourced."""
    try:
        return str(rospkg.RosPack().get_path(name))
    except rospkg.ResourceNotFound:
        return None
