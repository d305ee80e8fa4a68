"""The links between the robot's description and TF, as they are asked for."""

from __future__ import annotations

from collections.abc import Callable
from functools import cached_property, lru_cache

import rospkg
import rospy

from g1_description.core.doctor import robot as decide
from g1_description.core.doctor.faults import ASKED_PROCESS, Fault, fault
from g1_description.core.doctor.nodes import STATES, Graph
from g1_description.core.errors import G1DescriptionError
from g1_description.core.files.share import share_folder
from g1_description.core.files.uris import local_path
from g1_description.core.robot.description import Description
from g1_description.core.text import listed
from g1_description.core.urdf.reader import parse_urdf

from .master import Master
from .robot_setup import BRIDGE, RobotSetup
from .traffic import WAIT, Traffic

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
            cure = decide.cure_of_description(name, has_simulator)
            words = {"parameter": name, "namespace": space, "cure": cure}
            return fault("no_description", **words)
        try:
            self._known = parse_urdf(str(master.parameter(place)))
        except G1DescriptionError as error:
            cure = decide.cure_of_description(place, has_simulator)
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
        found = decide.meshes(lost, self._place, str(share_folder()))
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
        two = decide.publishers("two_clocks", nodes, self._setup.simulators)
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
            return decide.no_bridge(topic, self._setup.bridged_namespaces)
        two = decide.publishers("two_bridges", bridges, [BRIDGE], topic=topic)
        return two or bridges[0]

    def _model(self) -> Fault | str:
        """Ask the simulator for the bridge's model."""
        try:
            models = self._traffic.models(self._setup.gazebo)
        except FAILURES:
            return self._hung("get_world_properties")
        name, bridge = self._setup.robot.name, self._setup.bridges[0]
        names = self._states[0] if self._states else ()
        robots = decide.models_of(self._read, names, self._setup.models)
        return decide.model(name, models, robots, bridge, self._place) or name

    def _urdf(self) -> Fault | str:
        """Compare the model with the description."""
        name, states = self._setup.robot.name, self._states
        reason = states and decide.difference(self._read, name, *states)
        if not reason:
            return f"{name} is the robot on {self._place}"
        cure = decide.spawning(name, self._place)
        words = {"parameter": self._place, "gazebo": self._setup.gazebo, "cure": cure}
        return fault("other_urdf", model=name, reason=reason, **words)

    def _joint_states(self) -> Fault | str:
        """Listen to the joint states."""
        topic = self._setup.topic("joint_states")
        nodes = self._setup.publishers(topic)
        own = self._setup.bridges or nodes[:1]
        words = {"topic": topic, "own": listed(own)}
        two = decide.publishers("two_joint_states", nodes, own, **words)
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
        return found or decide.no_state_publisher(setup.made_from, setup.prefix)

    def _tf(self) -> Fault | str:
        """Listen to TF."""
        setup, known = self._setup, self._read
        expected = setup.edges(known)
        found = self._traffic.tf(
            setup.graph.publishers,
            lambda edges: not decide.missing_edges(edges, expected),
        )
        chain = [*setup.bridges, *setup.state_publishers]
        two = decide.tf_owners(found, chain, expected, setup.shared_edges(known))
        lost = decide.missing_edges(found, expected)
        if two or not lost:
            return two or f"{len(found)} edges"
        start = setup.made_from, setup.prefix
        if not setup.state_publishers:
            return decide.no_state_publisher(*start)
        owners = (setup.bridges or [""])[0], setup.state_publishers[0]
        return decide.no_tf(lost, setup.base_edges(known), owners, start)

    def _diagnostics(self) -> Fault | str:
        """Hear what the bridge says of itself; what is bad must be so once more."""
        node = self._setup.bridges[0]
        rounds = [self._traffic.diagnostics(node)]
        if decide.reports(node, rounds, WAIT):
            rounds.append(self._traffic.diagnostics(node))
        return decide.reports(node, rounds, WAIT) or node

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
