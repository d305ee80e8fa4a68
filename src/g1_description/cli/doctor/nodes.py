"""The nodes as the master knows them, and whether they are where they say."""

from __future__ import annotations

from collections.abc import Mapping, Set
from dataclasses import dataclass, field

from g1_description.cli.doctor.faults import Fault, fault

CHAIN = {"clock", "tf", "tf_static", "link_states", "world_state", "joint_states"}
CHAIN |= {"tf_joint_states", "set_model_configuration"}
"""Last names of the topics and services between the simulator and RViz."""

STATES = "tf_joint_states"
"""Last name of a topic that only a bridge publishes, for robot_state_publisher."""

UNKNOWN_HOST, ANSWERS = "its host is not known here", ""

SILENT = "no answer"
"""How the problem of a node begins that takes connections and does not answer."""


@dataclass(frozen=True)
class NodeAnswer:
    """What came of asking a node."""

    uri: str
    """Its address, as the master has it."""

    problem: str = ANSWERS
    """Why there is no answer, in few words; empty: there is one."""

    topics: Set[str] = frozenset()
    """What it says that it publishes."""

    is_here: bool = False
    """Whether its address is one of this machine."""

    is_loopback: bool = False
    """Whether its address means the machine that uses it."""

    stopped: str = ""
    """The number of the process at this address, if that has been stopped."""


@dataclass(frozen=True)
class Graph:
    """Which nodes publish, subscribe and serve what, by the full name."""

    publishers: dict[str, list[str]] = field(default_factory=dict)
    subscribers: dict[str, list[str]] = field(default_factory=dict)
    services: dict[str, list[str]] = field(default_factory=dict)

    @property
    def nodes(self) -> list[str]:
        """All nodes."""
        tables = (self.publishers, self.subscribers, self.services)
        found = {node for table in tables for nodes in table.values() for node in nodes}
        return sorted(found)

    def topics_of(self, node: str) -> list[str]:
        """List what a node publishes."""
        return [topic for topic, nodes in self.publishers.items() if node in nodes]

    def still(self, later: Graph) -> Graph:
        """Return the graph without what its nodes have stopped to publish since.

        Args:
            later: What the master knows later.
        """
        kept = {
            topic: [n for n in nodes if n in later.publishers.get(topic, ())]
            for topic, nodes in self.publishers.items()
        }
        return Graph(kept, self.subscribers, self.services)

    def of(self, nodes: Set[str]) -> Graph:
        """Return the graph without all other nodes."""
        tables = (self.publishers, self.subscribers, self.services)
        kept = [
            {name: [n for n in found if n in nodes] for name, found in table.items()}
            for table in tables
        ]
        return Graph(*[{k: v for k, v in table.items() if v} for table in kept])


def node_addresses(
    graph: Graph, answers: Mapping[str, NodeAnswer], master_is_here: bool
) -> Fault | None:
    """Judge whether the nodes are where they say.

    Args:
        graph: What the master knows.
        answers: What came of asking them.
        master_is_here: Whether the master is on this machine.
    """
    for node, answer in sorted(answers.items()):
        is_unanswered = answer.problem not in (ANSWERS, UNKNOWN_HOST)
        if is_unanswered and not is_in_chain(graph, node):
            continue  # nothing waits for it
        name, reason = _about(graph.topics_of(node), answer, master_is_here)
        if name:
            details = {"uri": answer.uri, "process": answer.stopped}
            return fault(name, node=node, reason=reason, **details)
    return None


def _about(
    topics: list[str], answer: NodeAnswer, master_is_here: bool
) -> tuple[str, str]:
    """Name the fault of a node's address, and why; both empty if there is none."""
    if answer.problem == ANSWERS:
        known = {*topics} - {"/rosout"}
        is_other = bool(known) and not known & answer.topics
        return ("wrong_node_address", "another node answers") if is_other else ("", "")
    if answer.problem == UNKNOWN_HOST:
        return "wrong_node_address", answer.problem
    if not answer.is_here:
        why = f"{answer.problem}: that is another machine, or the node has died"
        return "wrong_node_address", why
    if answer.is_loopback and not master_is_here:
        return "wrong_node_address", "each machine takes that for itself"
    if not answer.problem.startswith(SILENT):
        return "dead_node", answer.problem
    return "stopped_node" if answer.stopped else "hung_node", answer.problem


def is_in_chain(graph: Graph, node: str) -> bool:
    """Whether a node passes the robot's states on, from the simulator to TF."""
    names = {
        name.rpartition("/")[2]
        for table in (graph.publishers, graph.services)
        for name, nodes in table.items()
        if node in nodes
    }
    heard = (topic for topic, nodes in graph.subscribers.items() if node in nodes)
    return bool(names & CHAIN) or any(t.endswith(f"/{STATES}") for t in heard)
