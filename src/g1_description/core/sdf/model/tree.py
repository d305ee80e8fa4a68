"""The trees that the joints of an SDF model make of its links.

SDF lets joints be written in any direction and close loops; what is simulated is
made of trees whose joints lead away from the root.
"""

from __future__ import annotations

from collections.abc import Sequence

from g1_description.core.robot.assembly import WORLD
from g1_description.core.robot.description import Joint

from .joint import turned_around


def closes_loop(joints: Sequence[tuple[str, str]]) -> list[bool]:
    """Find which joints would close a loop.

    Args:
        joints: The two links that each joins, in any direction.

    Returns:
        For each joint whether those before it join its links already.
    """
    above: dict[str, str] = {}

    def top(link: str) -> str:
        path = [link]
        while path[-1] in above:
            path.append(above[path[-1]])
        above.update((passed, path[-1]) for passed in path[:-1])
        return path[-1]

    closing = []
    for ends in joints:
        first, second = map(top, ends)
        closing.append(first == second)
        if first != second:
            above[second] = first
    return closing


def hung(links: Sequence[str], joints: Sequence[Joint]) -> tuple[Joint, ...]:
    """Turn joints around where they lead to the root.

    The root of a tree is the world, else the first link that no joint carries.

    Args:
        links: Names of all links.
        joints: Joints that make no loop.

    Returns:
        The joints in the same order, none two of them with the same child.
    """
    result = list(joints)
    at: dict[str, list[int]] = {}
    for number, joint in enumerate(joints):
        at.setdefault(joint.parent, []).append(number)
        at.setdefault(joint.child, []).append(number)
    carried = {joint.child for joint in joints}
    reached: set[str] = set()
    for root in (WORLD, *(link for link in links if link not in carried)):
        waiting = [] if root in reached else [root]
        reached.add(root)
        for link in waiting:
            for number in at.get(link, ()):
                joint = result[number]
                other = joint.child if joint.parent == link else joint.parent
                if other in reached:
                    continue
                if joint.child == link:
                    result[number] = turned_around(joint)
                reached.add(other)
                waiting.append(other)
    return tuple(result)
