"""Robot descriptions on the parameter server."""

from __future__ import annotations

import time
from collections.abc import Sequence

import rosgraph
import rospy

from g1_description.core.robot.description import Description
from g1_description.core.urdf.reader import parse_urdf

from .parameters import RobotParameters


def wait_for_descriptions(
    robots: Sequence[RobotParameters],
) -> list[tuple[RobotParameters, Description]]:
    """Wait until all robots are on the parameter server.

    Args:
        robots: The parameters to wait for.

    Returns:
        The robots that were found, all unless the node was shut down. Equal texts give
        the same description.

    Raises:
        DescriptionError: If a parameter is no robot.
    """
    found = []
    parsed: dict[str, Description] = {}
    for robot in robots:
        text = _wait_for(robot)
        if text is None:
            break
        if text not in parsed:
            parsed[text] = parse_urdf(text)
        found.append((robot, parsed[text]))
    return found


def _wait_for(robot: RobotParameters) -> str | None:
    """Wait for one robot; None if the node was shut down before that."""
    is_logged = False
    while not rospy.is_shutdown():
        name = find_parameter(robot.description, robot.namespace)
        if name is not None:
            return str(rospy.get_param(name))
        if not is_logged:
            where = f"{robot.description}, from /{robot.namespace} upward"
            rospy.loginfo("Waiting for %s on the parameter %s.", robot.name, where)
            is_logged = True
        time.sleep(0.1)
    return None


def find_parameter(name: str, namespace: str = "") -> str | None:
    """Find a parameter in a namespace or one above it.

    Args:
        name: The parameter. A full name is only looked up, not searched for.
        namespace: Namespace to begin in; by default the node's.

    Returns:
        Its full name; None if there is none.
    """
    if name.startswith(("/", "~")):
        return rospy.resolve_name(name) if rospy.has_param(name) else None
    # The master begins in the caller's namespace. With the node's own name that would
    # be the one of its private parameters.
    begin = f"/{namespace}/" if namespace else rospy.get_namespace()
    try:
        return rosgraph.Master(f"{begin}anyone").searchParam(name)
    except rosgraph.MasterError:
        return None
