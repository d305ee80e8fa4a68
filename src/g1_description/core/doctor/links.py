"""The chain from the master to the picture."""

from __future__ import annotations

from dataclasses import dataclass

from .faults import Fault

OK, BROKEN, NOT_LOOKED_AT = "ok", "broken", "not looked at"

LINKS = {
    "python": "this Python is that of ROS, and the workspace is sourced",
    "packages": "the nodes have what they import",
    "master": "a master answers",
    "address": "nodes of this shell give an address that is theirs",
    "nodes": "all nodes are where they say",
    "description": "a robot is on the parameter server",
    "meshes": "its meshes are on this machine",
    "simulator": "a simulator runs and answers",
    "clock": "one node publishes the time",
    "time": "time is not paused, and comes",
    "link_states": "link states come",
    "bridge": "one bridge turns link states into joint states",
    "model": "the simulator has the model that the bridge shows",
    "urdf": "that model is the robot of the parameter server",
    "joint_states": "joint states come, and from one node",
    "state_publisher": "a robot_state_publisher turns them into TF",
    "tf": "TF is whole, and each edge has one owner",
    "diagnostics": "the bridge reports no fault",
    "picture": "RViz or the browser view shows the robot",
}
"""What holds if a link is whole, by its name. They are walked in this order: each needs
those before it."""


@dataclass(frozen=True)
class Walked:
    """What was found of a link."""

    name: str
    state: str
    """``OK``, ``BROKEN`` or ``NOT_LOOKED_AT``."""

    remark: str = ""
    """What was seen, in few words."""

    fault: Fault | None = None
