"""The set-up of a robot: which nodes, parameters and edges of TF belong to it."""

from __future__ import annotations

from dataclasses import fields
from typing import Any

from g1_description.core.doctor.nodes import STATES, Graph
from g1_description.core.errors import G1DescriptionError
from g1_description.core.robot.description import MOVABLE, Description
from g1_description.core.text import listed
from g1_description.ros.bridge.frames import base_child, static_edges
from g1_description.ros.bridge.parameters import BridgeParameters, RobotParameters

from .master import Master

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
