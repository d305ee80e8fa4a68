"""The topics and services of the nodes that run are those of docs/nodes.md."""

import re
import unittest

import rosgraph
import rospy
import rosservice
from pages import ROOT
from waiting import wait_for

PAGE = (ROOT / "docs" / "nodes.md").read_text(encoding="utf-8")
ROW = re.compile(r"^\| (publishes|subscribes|serves) ([^|]+) \| ([^|]+) \|", flags=re.M)
KINDS = ("publishes", "subscribes", "serves")
OF_ALL = re.compile(
    r"/rosout|/clock|/tf(_static)?|.*/(get_loggers|set_logger_level)"
    r"|.*_trajectory/(goal|cancel|status|feedback|result)"
)
"""What every node has; TF is on the page by its frames, an action by its name."""


def listed(node):
    """List what the page says of a node: what it does, resolved names, and types."""
    section = re.split(rf"^## {node}$", PAGE, flags=re.M)[1].split("\n## ")[0]
    found = set()
    for kind, names, types in ROW.findall(section):
        names = re.findall(r"`([^`]+)`", names)
        types = re.sub(r"\[([^]]+)\]\([^)]*\)", r"\1", types).split(", ")
        for name, one in zip(names, types * len(names)):
            found.add((kind, rospy.resolve_name(name, f"/{node}"), one))
    return found


def running(node):
    """List what the master knows of a node: what it does, and names."""
    return {
        (kind, name)
        for kind, table in zip(KINDS, rosgraph.Master("/test").getSystemState())
        for name, nodes in table
        if f"/{node}" in nodes and not OF_ALL.fullmatch(name)
    }


def type_of(kind, name):
    """Return the type of a topic or a service."""
    if kind == "serves":
        return rosservice.get_service_type(name)
    return dict(rosgraph.Master("/test").getTopicTypes()).get(name)


class TestGraph(unittest.TestCase):
    def test_the_page_lists_what_the_nodes_have(self):
        """Some topics are subscribed to only without others, or for a browser."""
        for node in ("gazebo", "link_states_bridge", "checker", "interactive", "web"):
            known = listed(node)
            offered = {(kind, n) for kind, n, _ in known if kind != "subscribes"}
            wait_for(lambda n=node, o=offered: o <= running(n), f"{offered} of {node}")
            found = {(*row, type_of(*row)) for row in running(node)}
            if node == "gazebo":  # the rest is Gazebo's own
                found = {row for row in found if row[2].startswith("g1_description/")}
            self.assertEqual(found - known, set(), node)
